"""Maps of point clouds: displacements of the surface at the deepest depth, measured, simulated, and what is between."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm

from rso.core.digits import known
from rso.report.canvas import ACCENT, INK, PAPER, WARM, canvas, svg
from rso.report.layout.digits import clean, quantity, shown
from rso.report.layout.document import Block, Picture
from rso.report.reading import Results, listed, number

CLOUD_PICTURE = "cloud"
_MARK_COMPONENT = re.compile(r"(u[xyz])\((.*),(.*)\)")
_SIGNED_COLOURS = LinearSegmentedColormap.from_list("both", [ACCENT, "#f4f3ef", WARM])
_COLOUR_SCALE_SD = 3.0  # standard deviations at the ends of the scale


@dataclass(frozen=True, eq=False)
class CloudMap:
    """Readings (n,) of a cloud in mm, their places (n, 2), what was simulated, and the standard deviation of both."""

    experiment: str
    role: str
    component: np.ndarray
    place: np.ndarray
    depth: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray
    sigma: np.ndarray
    p_value: float | None

    @property
    def deepest(self) -> np.ndarray:
        """(n,) whether a reading is one of the deepest image."""
        return self.depth > self.depth.max() * (1.0 - 1e-9)

    @property
    def off(self) -> np.ndarray:
        """Measured − simulated (n,) in standard deviations."""
        return (self.measured - self.simulated) / np.where(self.sigma > 0.0, self.sigma, np.inf)


def cloud_maps(results: Results) -> list[CloudMap]:
    """Every point cloud of a study that was fitted or predicted."""
    found = []
    for d in (results.get("identification") or {}).get("data") or ():
        fitted = d.get("fitted") or {}
        if d.get("marks") and fitted:
            found.append(_map(d["experiment"], "fit", d, fitted["depth"], fitted["value"], fitted["reading_sd"], None))
    for p in listed(results, "predictions"):
        for c in p.get("channels") or ():
            if c.get("marks"):
                open_ = np.hypot(_array(c["sigma"]), np.hypot(_array(c["numerical_error"]), _array(c["spread"])))
                p_value = number(p.get("p_value"))
                found.append(_map(p["experiment"], "validate", c, c["depth"], c["predicted"], open_, p_value))
    return [m for m in found if m is not None]


def cloud_blocks(results: Results) -> list[Block]:
    """A map of every cloud."""
    return [Picture(f"{CLOUD_PICTURE}-{k}", _caption(m)) for k, m in enumerate(cloud_maps(results))]


def cloud_figure(results: Results, k: int, name: str) -> str:
    """A row for each component at the deepest depth: measured, simulated, the difference in standard deviations."""
    m = cloud_maps(results)[k]
    names = list(dict.fromkeys(m.component.tolist()))
    figure = canvas(0.4 + 2.1 * len(names))
    grid = figure.subplots(len(names), 3, sharex=True, sharey=True, squeeze=False)
    for row, component in zip(grid, names, strict=True):
        mine = m.deepest & (m.component == component)
        x, y = m.place[mine].T
        unit = shown("mm", float(np.abs(m.measured[mine]).max()))
        size = max(float(np.abs([m.measured[mine], m.simulated[mine]]).max()), 1e-300) * unit.factor
        for axes, values, limit, title in (
            (row[0], m.measured[mine] * unit.factor, size, f"{component} measured{unit.bracket}"),
            (row[1], m.simulated[mine] * unit.factor, size, f"{component} simulated{unit.bracket}"),
            (row[2], m.off[mine], _COLOUR_SCALE_SD, f"{component} difference (σ)"),
        ):
            norm = TwoSlopeNorm(0.0, -limit, limit)
            drawn = axes.scatter(x, y, c=values, s=30, cmap=_SIGNED_COLOURS, norm=norm, edgecolors=INK, linewidths=0.4)
            figure.colorbar(drawn, ax=axes, shrink=0.85)
            axes.set_title(title, fontsize=8)
            axes.set_aspect("equal", adjustable="box")
            axes.set_facecolor(PAPER)
        row[0].set_ylabel("y (mm)")
    for axes in grid[-1]:
        axes.set_xlabel("x (mm)")
    return svg(figure, name)


def _caption(m: CloudMap) -> str:
    what = "was fitted" if m.role == "fit" else "was not used for the fit"
    deepest = float(m.depth.max())
    near = int(np.sum(np.abs(m.off) <= 2.0))
    text = f"Point cloud {clean(m.experiment)}, which {what}, at a depth of {quantity(deepest, 'mm', 3)}: measured, "
    text += f"simulated, and the difference in standard deviations. {near} of {len(m.off)} readings at all depths lie "
    text += "within 2σ."
    return text + (f" Posterior predictive check: p = {m.p_value:.2g}." if m.p_value is not None else "")


def _map(
    experiment: str, role: str, row: Mapping[str, Any], depth: Any, simulated: Any, sigma: Any, p_value: float | None
) -> CloudMap | None:
    marks = [_MARK_COMPONENT.fullmatch(str(v)) for v in row["marks"]]
    arrays = [_array(v) for v in (depth, row.get("measured") or (), simulated, sigma)]
    if not marks or not all(marks) or any(len(a) != len(marks) or not np.isfinite(a).all() for a in arrays):
        return None
    each = [m.groups() for m in marks if m is not None]
    place = np.array([[float(x), float(y)] for _, x, y in each])
    u, y, f, s = arrays
    return CloudMap(experiment, role, np.array([c for c, _, _ in each]), place, u, y, f, s, p_value)


def _array(values: Any) -> np.ndarray:
    return np.array([float(v) if known(v) else np.nan for v in values], float)
