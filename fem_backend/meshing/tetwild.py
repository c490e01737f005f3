"""fTetWild on a graded surface with a background sizing field; run as a module it meshes one recipe."""

from __future__ import annotations

import ctypes
import functools
import importlib.machinery
import importlib.util
import json
import signal
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
from skfem import MeshTet

from fem_backend.geometry import EllipsoidShape
from fem_backend.meshing.mesh import BadMesh, Mesh, Sizing, finish, volumes
from fem_backend.meshing.placing import MIN_SCALED_JACOBIAN, assemble, scaled_jacobian
from fem_backend.meshing.surface import quarter_surface

TETWILD_EPSILON = (1e-3, 1e-3, 5e-4, 1e-3, 5e-4, 2e-4)  # surface tolerance by the diagonal, tried in turn
PLACED_SHARES = (0.0, 0.0), (0.35, 0.0), (0.0, 0.35)  # shares of the semi-axes: where further tests are proposed
TETWILD_SCALE = 0.72  # fTetWild's mean edge is 1.3 to 1.4 times what it is asked for


def tetwild_quarter(body: EllipsoidShape, sizing: Sizing) -> Mesh:
    """Quarter ellipsoid by fTetWild (Hu et al. 2020) with a background sizing field about the top.

    One with which points off the top could not be reached is made again (no two are alike), at the end the best taken.
    Raises BadMesh when no result is the quarter body (volume off by more than 8 %, inverted or spoilt elements).
    """
    vertices, faces = quarter_surface(body, sizing)
    background = _background(body, sizing)
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    best, most, refused = None, -np.inf, BadMesh("fTetWild was not asked")
    for epsilon in TETWILD_EPSILON:
        points, tets = tetrahedra(vertices, faces, sizing.hmax, epsilon, background)
        try:
            mesh = finish(body, points, tets, 1.5 * epsilon * diagonal)
            assemble(mesh, body, body)  # sound as a quadratic mesh too: a sliver may have a volume and no use
        except BadMesh as error:
            refused = error
            continue
        sound = placed_quality(mesh, body)
        if sound >= MIN_SCALED_JACOBIAN:
            return mesh
        if sound > most:
            best, most = mesh, sound
    if best is None:
        raise refused
    return best


def tetrahedra(
    vertices: np.ndarray,
    faces: np.ndarray,
    longest: float,
    epsilon: float,
    background: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and tetrahedra (m, 4) of fTetWild inside a surface that is graded already.

    `epsilon` is the tolerance of the surface by its diagonal; `background` are points, tetrahedra and edge lengths.
    """
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    points, tets = _extension().tetrahedralize_mesh(
        vertices,
        faces.astype(np.uint32),
        True,
        True,  # optimise, keep the surface
        longest / diagonal,
        0.0,
        epsilon,
        10.0,
        False,
        1,
        80,
        6,
        True,
        True,
        False,
        *background,
    )
    return np.asarray(points, float), np.asarray(tets, int)


def placed_quality(mesh: Mesh, body: EllipsoidShape) -> float:
    """Smallest scaled Jacobian that the quarter mesh of a body has with its fine elements at places on the axes."""
    shapes = []
    for p, q in PLACED_SHARES:
        placed = assemble(mesh, body, body, (p * body.a, q * body.b), (p == 0.0, q == 0.0), upright=True, least=-np.inf)
        shapes.append(float(scaled_jacobian(placed).min()))
    return min(shapes)


@functools.cache
def _extension() -> ModuleType:
    """pytetwild's compiled module alone: its package imports pyvista (600 MB) only for file conversion."""
    spec = importlib.util.find_spec("pytetwild")
    if spec is None or not spec.submodule_search_locations:
        raise ImportError("pytetwild is not installed; install pytetwild==0.4.*")
    folder = Path(spec.submodule_search_locations[0])
    for suffix in importlib.machinery.EXTENSION_SUFFIXES:
        path = folder / f"PyfTetWildWrapper{suffix}"
        if path.exists():
            module_spec = importlib.util.spec_from_file_location("PyfTetWildWrapper", path)
            assert module_spec is not None and module_spec.loader is not None  # its suffix is that of a loader
            module = importlib.util.module_from_spec(module_spec)
            module_spec.loader.exec_module(module)
            return module
    raise ImportError(f"pytetwild in {folder} has no compiled module for this Python; reinstall pytetwild==0.4.*")


def _background(body: EllipsoidShape, sizing: Sizing) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A graded box of Kuhn tetrahedra around the quarter body carrying the target edge length."""

    def ticks(low: float, high: float, centre: float) -> np.ndarray:
        out = [centre]
        for end in (low, high):
            x = centre
            while x != end:
                step = max(0.5, 0.3 * abs(x - centre))
                x = max(x - step, end) if end < centre else min(x + step, end)
                out.append(x)
        return np.unique(out)

    axes = [ticks(-1.0, body.a + 1, 0.0), ticks(-1.0, body.b + 1, 0.0), ticks(-body.c - 1, body.c + 1, body.c)]
    box = MeshTet.init_tensor(*axes)
    points = box.p.T.copy()
    tets = box.t.T.astype(np.int32)
    flipped = volumes(Mesh(points, tets)) < 0
    tets[flipped] = tets[flipped][:, [0, 2, 1, 3]]
    return points, tets, TETWILD_SCALE * sizing.at(points, body)


def die_with_parent() -> None:
    """Ask Linux to kill this process when its parent dies: native code would mesh on for nobody."""
    try:
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    except (AttributeError, OSError):
        return  # not Linux: the time-out of the parent is all there is


if __name__ == "__main__":
    die_with_parent()
    _recipe = json.loads(sys.argv[1])
    _mesh = tetwild_quarter(EllipsoidShape(*_recipe["semi_axes"]), Sizing(**_recipe["sizing"]))
    Path(sys.argv[2]).write_bytes(_mesh.to_bytes())
