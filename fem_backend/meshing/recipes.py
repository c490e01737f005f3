"""Recipes: a mesh in words, made once and kept."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np

from fem_backend.geometry import Ellipsoid
from fem_backend.meshing.mapped import mapped_quarter
from fem_backend.meshing.mesh import BadMesh, Mesh, Sizing
from fem_backend.meshing.templates import NOMINAL, template_hash, template_mesh

ALIVE = 10.0  # s between two signs of life of a mesher


def make(recipe: str) -> Mesh:
    """Mesh from its recipe (JSON with the keys mesher, semi_axes and size or level).

    fTetWild runs in a child process: it is native code that can crash, and it litters its working directory.
    Raises BadMesh when it fails.
    """
    data = json.loads(recipe)
    if data["mesher"] == "mapped":
        return mapped_quarter(Ellipsoid(*data["semi_axes"]), data["n"], data["slip"])
    if data["mesher"] == "template":
        if template_hash(data["level"]) != data["sha256"]:
            raise BadMesh(f"the template {data['level']!r} of this version is not the one of the recipe")
        mesh = template_mesh(data["level"])
        return Mesh(mesh.vertices * (np.array(data["semi_axes"]) / NOMINAL.semi_axes), mesh.tets)
    with tempfile.TemporaryDirectory() as folder:
        child = [sys.executable, "-m", "fem_backend.meshing.tetwild", recipe, "mesh.npz"]
        path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
        environment = {**os.environ, "PYTHONPATH": path}
        try:
            with _said(data["semi_axes"]):
                done = subprocess.run(child, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
        except subprocess.TimeoutExpired:
            raise BadMesh("fTetWild took more than 600 s") from None
        if done.returncode != 0:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise BadMesh(f"fTetWild ended with code {done.returncode}: {last}")
        return Mesh.from_file(Path(folder) / "mesh.npz")


@contextlib.contextmanager
def _said(semi_axes: list[float]) -> Iterator[None]:
    """Signs of life on stderr while fTetWild works: at once, then every ten seconds, then how long it took."""
    axes, began, over = " x ".join(f"{v:.4g}" for v in semi_axes), time.monotonic(), threading.Event()
    what = f"meshing a new specimen (scaled semi-axes {axes} mm) with fTetWild"

    def tell() -> None:
        while not over.wait(ALIVE):
            print(f"  {what}: {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)

    print(f"  {what}: once, 10 to 90 s; the mesh is kept for later studies", file=sys.stderr, flush=True)
    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield
    finally:
        over.set()
        teller.join()
    print(f"  {what}: made in {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)


def nominal(recipe: str) -> Ellipsoid:
    """The body (mm) that the mesh of a recipe stands for: similar specimens of all sizes may share one."""
    return Ellipsoid(*json.loads(recipe)["semi_axes"])


def mesher(recipe: str) -> str:
    """Who makes the mesh of a recipe: template, tetwild or mapped."""
    return str(json.loads(recipe)["mesher"])


def tetwild_recipe(body: Ellipsoid, sizing: Sizing) -> str:
    """Recipe of a graded fTetWild mesh of the quarter body."""
    words = {k: v for k, v in asdict(sizing).items() if k != "lift" or v}  # recipes without it are as they were
    return json.dumps(
        {"mesher": "tetwild", "version": 2, "semi_axes": list(body.semi_axes), "sizing": words}, sort_keys=True
    )


def mapped_recipe(body: Ellipsoid, n: int, slip: float) -> str:
    """Recipe of the reproducible mapped mesh: n subdivisions, grading `slip` in [0, 1)."""
    return json.dumps(
        {"mesher": "mapped", "version": 1, "semi_axes": list(body.semi_axes), "n": n, "slip": slip}, sort_keys=True
    )


def template_recipe(level: str, body: Ellipsoid = NOMINAL) -> str:
    """Recipe of the shipped quarter mesh of a level, scaled to `body`; equal bits on every machine.

    Its hash makes a changed template a different recipe.
    """
    return json.dumps(
        {"mesher": "template", "version": 1, "semi_axes": [float(v) for v in body.semi_axes], "level": level,
         "sha256": template_hash(level)}, sort_keys=True
    )  # fmt: skip


def cached(recipe: str) -> Mesh:
    """Mesh of a recipe from this user's cache, made there if missing: two studies then share one mesh."""
    if json.loads(recipe)["mesher"] == "template":
        return make(recipe)  # it lies beside the program already
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    path = base / "rso-meshes" / f"{hashlib.sha256(recipe.encode()).hexdigest()}.npz"
    if not path.exists():
        mesh = make(recipe)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary = path.with_suffix(f".{os.getpid()}")
            temporary.write_bytes(mesh.to_bytes())
            try:
                os.link(temporary, path)  # the first of two racing processes wins: both then read the same mesh
            except FileExistsError:
                pass
            temporary.unlink()
        except OSError:
            return mesh  # no writable home: the caller's store keeps the artefact
    return Mesh.from_file(path)
