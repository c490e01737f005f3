"""Recipes: a mesh in words, made once and kept."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from fem_backend.geometry import EllipsoidShape
from fem_backend.meshing.mapped import mapped_quarter
from fem_backend.meshing.mesh import BadMesh, Mesh, Sizing, volumes
from fem_backend.meshing.templates import TEMPLATE_BODY, template_hash, template_mesh

SIGN_OF_LIFE_S = 10.0  # between two signs of life of a mesher
LIMIT_LEVEL = "limit"  # the mesh level whose forces are extrapolated, see fem_backend.accuracy.two_grid
MAKERS: dict[str, Callable[[Mapping[str, Any]], Mesh]] = {}  # of meshes of other bodies, by the mesher in a recipe
QUARTER_VOLUME_TOLERANCE = 0.09  # of the volume: straight edges of a coarse mesh cut that much off, see `finish`


def make_mesh(recipe: str) -> Mesh:
    """Mesh from its recipe (JSON with the keys mesher, semi_axes and size or level).

    fTetWild runs in a child process: it is native code that can crash, and it litters its working directory.
    Raises BadMesh when it fails.
    """
    data = json.loads(recipe)
    if data["mesher"] in MAKERS:
        return MAKERS[data["mesher"]](data)
    if data["mesher"] == "mapped":
        return mapped_quarter(EllipsoidShape(*data["semi_axes"]), data["n"], data["slip"])
    if data["mesher"] == "template":
        if template_hash(data["level"]) != data["sha256"]:
            raise BadMesh(f"the template {data['level']!r} of this version is not the one of the recipe")
        mesh = template_mesh(data["level"])
        return Mesh(mesh.vertices * (np.array(data["semi_axes"]) / TEMPLATE_BODY.semi_axes), mesh.tets)
    axes = " x ".join(f"{v:.4g}" for v in data["semi_axes"])
    return in_child("fem_backend.meshing.tetwild", recipe, f"a new specimen (scaled semi-axes {axes} mm)")


def in_child(module: str, recipe: str, what: str) -> Mesh:
    """What `python -m module recipe file` writes into the file; raises BadMesh where it fails."""
    with tempfile.TemporaryDirectory() as folder:
        child = [sys.executable, "-m", module, recipe, "mesh.npz"]
        path = os.pathsep.join(filter(None, [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH")]))
        environment = {**os.environ, "PYTHONPATH": path}
        try:
            with _said(f"meshing {what} with fTetWild"):
                done = subprocess.run(child, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
        except subprocess.TimeoutExpired:
            raise BadMesh("fTetWild took more than 600 s") from None
        if done.returncode != 0:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            own = f"{BadMesh.__module__}.{BadMesh.__qualname__}: "
            if last.startswith(own):  # which says what is wrong with the body, whatever meshed it
                raise BadMesh(last.removeprefix(own))
            raise BadMesh(f"fTetWild ended with code {done.returncode}: {last}")
        return Mesh.from_file(Path(folder) / "mesh.npz")


@contextlib.contextmanager
def _said(what: str) -> Iterator[None]:
    """Signs of life on stderr while fTetWild works: at once, then every ten seconds, then how long it took."""
    began, over = time.monotonic(), threading.Event()

    def tell() -> None:
        while not over.wait(SIGN_OF_LIFE_S):
            print(f"  {what}: {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)

    print(f"  {what}: once, 10 to 90 s; the mesh is stored for later studies", file=sys.stderr, flush=True)
    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield
    finally:
        over.set()
        teller.join()
    print(f"  {what}: made in {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)


def nominal_body(recipe: str) -> EllipsoidShape:
    """The body (mm) that the mesh of a recipe stands for: similar specimens of all sizes may share one."""
    return EllipsoidShape(*json.loads(recipe)["semi_axes"])


def mesher(recipe: str) -> str:
    """Who makes the mesh of a recipe: template, tetwild or mapped."""
    return str(json.loads(recipe)["mesher"])


def tetwild_recipe(body: EllipsoidShape, sizing: Sizing) -> str:
    """Recipe of a graded fTetWild mesh of the quarter body."""
    words = {k: v for k, v in asdict(sizing).items() if k != "lift" or v}  # recipes without it are as they were
    return json.dumps(
        {"mesher": "tetwild", "version": 2, "semi_axes": list(body.semi_axes), "sizing": words}, sort_keys=True
    )


def mapped_recipe(body: EllipsoidShape, n: int, slip: float) -> str:
    """Recipe of the reproducible mapped mesh: n subdivisions, grading `slip` in [0, 1)."""
    return json.dumps(
        {"mesher": "mapped", "version": 1, "semi_axes": list(body.semi_axes), "n": n, "slip": slip}, sort_keys=True
    )


def template_recipe(level: str, body: EllipsoidShape = TEMPLATE_BODY) -> str:
    """Recipe of the shipped quarter mesh of a level, scaled to `body`; equal bits on every machine.

    Its hash makes a changed template a different recipe.
    """
    return json.dumps(
        {
            "mesher": "template",
            "version": 1,
            "semi_axes": [float(v) for v in body.semi_axes],
            "level": level,
            "sha256": template_hash(level),
        },
        sort_keys=True,
    )


def cached(recipe: str) -> Mesh:
    """Mesh of a recipe from this user's cache, made there if missing: two studies then share one mesh.

    Nothing is believed of a file in the cache: it must be this user's alone, carry the recipe and the SHA-256 of the
    mesh, and hold the body of the recipe; any other is made again and replaced.
    """
    if mesher(recipe) == "template":
        return make_mesh(recipe)  # it lies beside the program already
    own = identity(recipe)
    path = cache() / f"{hashlib.sha256(own.encode()).hexdigest()}.npz"
    found = _kept(path, own)
    if found is not None:
        return found
    mesh = make_mesh(recipe)
    _keep(path, own, mesh.to_bytes())
    return _kept(path, own) or mesh  # the first of two racing processes wins: both then use the same mesh


def identity(recipe: str) -> str:
    """The recipe without the places of files whose contents it names by `sha256`: they are not what the mesh is."""

    def without(value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        return {k: without(v) for k, v in value.items() if not (k == "file" and "sha256" in value)}

    return recipe if '"file"' not in recipe else json.dumps(without(json.loads(recipe)), sort_keys=True)


def cache() -> Path:
    """Folder of this user's meshes; below no home there is none, and nothing can be kept there."""
    try:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # who has no home has no cache
        base = Path(os.devnull)
    return base / "rso-meshes"


def _private(path: Path) -> bool:
    """Whether a file or folder is this user's own, no link, and nobody else may write to it."""
    found = path.lstat()
    return found.st_uid == os.getuid() and not stat.S_ISLNK(found.st_mode) and not found.st_mode & 0o022


def _marked(recipe: str, data: bytes) -> bytes:
    """The bytes of an npz with recipe and SHA-256 as the comment of its archive, which readers of npz pass over."""
    comment = f"rso mesh 1 {hashlib.sha256(data).hexdigest()} {recipe}".encode()
    return data[:-2] + len(comment).to_bytes(2, "little") + comment


def _kept(path: Path, recipe: str) -> Mesh | None:
    """The mesh of the recipe in a file of the cache; None where there is none that can be believed."""
    try:
        if not (_private(path.parent) and _private(path) and path.is_file()):
            return None
        raw = path.read_bytes()
        data = raw[: len(raw) - len(_marked(recipe, bytes(2)))] + bytes(2)
        if raw != _marked(recipe, data):
            return None
        mesh = Mesh.from_bytes(data)
        v = volumes(mesh)
        if mesher(recipe) in MAKERS:
            return mesh if v.min() > 0 else None
        stands_for = v.min() > 0 and abs(v.sum() / (nominal_body(recipe).volume() / 4) - 1) <= QUARTER_VOLUME_TOLERANCE
    except (OSError, ValueError, IndexError, TypeError, MemoryError):
        return None
    return mesh if stands_for else None


def _keep(path: Path, recipe: str, data: bytes) -> None:
    """Put a mesh into the cache, whole or not at all; without a place for it the caller's store keeps the artefact."""
    part = path.with_suffix(f".{os.getpid()}")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not _private(path.parent):
            return
        part.unlink(missing_ok=True)
        with open(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600), "wb") as file:
            file.write(_marked(recipe, data))
        if _kept(path, recipe) is None:
            os.replace(part, path)
        part.unlink(missing_ok=True)
    except OSError:
        return
