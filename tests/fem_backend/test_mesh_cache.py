"""The user's cache of meshes: nothing in it is believed but the mesh of the recipe, whole and the user's own."""

import os

import numpy as np
import pytest

from fem_backend.geometry import EllipsoidShape
from fem_backend.meshing import recipes

RECIPE = recipes.mapped_recipe(EllipsoidShape(6.0, 4.0, 4.0), 8, 0.3)
OTHER = recipes.mapped_recipe(EllipsoidShape(6.0, 4.0, 5.0), 8, 0.3)


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """The file in which the mesh of RECIPE is kept, how often a mesh was made, and the mesh."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made, make = [], recipes.make_mesh
    monkeypatch.setattr(recipes, "make_mesh", lambda recipe: made.append(recipe) or make(recipe))
    mesh = recipes.cached(RECIPE)
    (file,) = (tmp_path / "rso-meshes").iterdir()
    recipes.cached(OTHER)
    made.clear()
    return file, made, mesh


def same(a, b) -> bool:
    return np.array_equal(a.vertices, b.vertices) and np.array_equal(a.tets, b.tets)


def test_a_whole_mesh_is_made_once_and_is_an_npz(kept):
    file, made, mesh = kept
    assert same(recipes.cached(RECIPE), mesh) and made == []
    assert same(recipes.Mesh.from_file(file), mesh)  # other readers see an ordinary file


@pytest.mark.parametrize(
    "spoil", ["cut", "empty", "flipped", "other body", "bare", "group", "link", "two names", "folder open"]
)
def test_what_is_not_that_mesh_is_made_again_and_replaced(kept, spoil):
    file, made, mesh = kept
    raw = file.read_bytes()
    other = next(f for f in file.parent.iterdir() if f != file)
    match spoil:
        case "cut":
            file.write_bytes(raw[: len(raw) // 2])
        case "empty":
            file.write_bytes(b"")
        case "flipped":
            file.write_bytes(raw[:500] + bytes([raw[500] ^ 1]) + raw[501:])
        case "other body":
            file.write_bytes(other.read_bytes())
        case "bare":
            file.write_bytes(recipes.make_mesh(OTHER).to_bytes())
            made.clear()
        case "group":
            file.chmod(0o666)
        case "link":
            file.unlink()
            file.symlink_to(other)
        case "two names":
            file.unlink()
            os.link(other, file)
        case "folder open":
            file.parent.chmod(0o777)
    assert same(recipes.cached(RECIPE), mesh) and made == [RECIPE]
    if spoil != "folder open":  # there nothing is kept
        assert same(recipes.cached(RECIPE), mesh) and made == [RECIPE]
        assert not file.is_symlink() and same(recipes.cached(OTHER), recipes.make_mesh(OTHER))


def test_without_a_home_a_mesh_is_made_and_used(monkeypatch, tmp_path):
    blocked = tmp_path / "home"
    blocked.touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    assert recipes.cached(RECIPE).tets.shape[1] == 4
    monkeypatch.delenv("XDG_CACHE_HOME")

    def nobody():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(recipes.Path, "home", nobody)
    assert recipes.cached(RECIPE).tets.shape[1] == 4
