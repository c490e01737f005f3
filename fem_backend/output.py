"""Files and pictures of a run: VTU for ParaView, sections and the surface as PNG."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fem_backend import post
from fem_backend.adapter.deformed import state_fields
from fem_backend.backend import Solved
from fem_backend.contact import tractions


def write_files(solved: Solved, folder: Path) -> list[Path]:
    """One VTU file per asked instant: displacement, Cauchy stress, von Mises, stretches, J, pressure, stiffness.

    Part models are written as they are; the frame is the specimen's, lengths mm, stresses MPa.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for k, point in enumerate(solved.result.points):
        system = solved.on(point).system
        body, surface = system.body, system.pressing.surface
        nodal = post.nodal(body, state_fields(solved.on(point), point))
        pressure = post.pressure_at_nodes(surface, point.evaluation.contact.pressure, len(body.nodes))
        data = {
            "cauchy_MPa": nodal.cauchy,
            "von_mises_MPa": nodal.von_mises,
            "stretches": nodal.stretches,
            "J": nodal.J,
            "contact_pressure_MPa": pressure,
        }
        scale = system.scale
        cells = {} if scale is None else {"stiffness_ratio": (scale * body.w).sum(1) / body.w.sum(1)}
        paths.append(folder / f"{k:03d}_{point.travel:.3f}mm.vtu")
        post.write_vtu(paths[-1], body, point.evaluation.u, data, cells)
    return paths


def draw_pictures(solved: Solved, folder: Path) -> list[Path]:
    """Two PNG per asked instant: a section through the contact and the surface from above."""
    from fem_backend.post import pictures

    folder.mkdir(parents=True, exist_ok=True)
    placement, paths = solved.placement, []
    for k, point in enumerate(solved.result.points):
        on = solved.on(point)
        body, surface = on.system.body, on.system.pressing.surface
        nodal = post.nodal(body, state_fields(solved.on(point), point))
        u, touch = point.evaluation.u, point.load.pressing
        points = tractions.contact_points(surface, body.nodes + u)
        pressed = point.evaluation.contact.pressure > 0
        spikes = (points[pressed], point.evaluation.contact.pressure[pressed]) if pressed.any() else None
        force = solved.result.Fz[k]
        title = f"travel {point.travel:g} mm, Fz = {force:.4g} N"
        normal = (0.0, 1.0, 0.0) if placement.planes[1] or not placement.planes[0] else (1.0, 0.0, 0.0)
        paths.append(folder / f"{k:03d}_section.png")
        pictures.draw_section(
            paths[-1],
            body,
            u,
            nodal.von_mises,
            "von Mises stress (MPa)",
            touch.centre,
            placement.indenter,
            touch.direction,
            normal,
            placement.planes,
            title,
            spikes,
            float(solved.result.channels["peak_pressure"][k]),
        )
        paths.append(folder / f"{k:03d}_surface.png")
        pictures.draw_surface(
            paths[-1],
            body.nodes,
            on.model.facets,
            u,
            np.ascontiguousarray(u[:, 2]),
            "vertical displacement (mm)",
            placement.planes,
            touch.centre,
            placement.indenter.length,
            title,
        )
    return paths
