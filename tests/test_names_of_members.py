"""Nothing outside the folders of the open sets names one of their members: what is asked there goes to the member."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from fem_backend.indenters import INDENTERS
from fem_backend.laws import LAWS
from fem_backend.specimens import SPECIMENS
from fem_backend.supports import SUPPORTS

ROOT = Path(__file__).parents[1]
FOLDERS = ("specimens", "indenters", "supports", "laws")
SETS = (SPECIMENS, INDENTERS, SUPPORTS, LAWS)
SHAPES = {"ellipsoid", "ellipsoidal", "bowl", "ball", "sphere", "spherical", "R"}
OTHERS = {"profile"}  # members whose name is a key of the settings, too: there it means surface marks
# What still names a shape, and why; a file that no longer does has to leave the list.
ALLOWED = {
    "fem_backend/adapter/stated_sizes.py": "words that files of instruments have for a tip",
    "fem_backend/geometry.py": "the shape itself, whose distances specimen, bowl and holes share",
    "fem_backend/meshing/mapped.py": "makes meshes of this one specimen",
    "fem_backend/meshing/mesh.py": "makes meshes of this one specimen",
    "fem_backend/meshing/placing.py": "makes meshes of this one specimen",
    "fem_backend/meshing/recipes.py": "makes meshes of this one specimen, others by `MAKERS`",
    "fem_backend/meshing/refined.py": "makes meshes of this one specimen",
    "fem_backend/meshing/remeshed.py": "the name of a method of scipy's trees",
    "fem_backend/meshing/surface.py": "makes meshes of this one specimen",
    "fem_backend/meshing/templates/__init__.py": "makes meshes of this one specimen",
    "fem_backend/meshing/tetwild.py": "makes meshes of this one specimen",
    "fem_backend/materials/zones.py": "a hole or an inclusion is an ellipsoid in every specimen",
    "fem_backend/closed_forms/__init__.py": "oracles by the name that the literature has for them",
    "fem_backend/closed_forms/adhesion.py": "oracles by the name that the literature has for them",
    "fem_backend/closed_forms/approximations.py": "oracles by the name that the literature has for them",
    "fem_backend/closed_forms/formulas.py": "which formula the literature has for a shape",
    "fem_backend/closed_forms/half_space.py": "oracles by the name that the literature has for them",
    "fem_backend/closed_forms/layer.py": "oracles by the name that the literature has for them",
    "fem_backend/simulation/contact_elements.py": "the effective radius R of Tabor's parameter",
    "fem_backend/adapter/command_line.py": "`rso new` and nominal.json of a laboratory know one specimen only",
}


def named(source: str, mechanics: bool = True) -> Iterator[str]:
    """Shapes and members that code names, without comments and docstrings: in identifiers, attributes and texts.

    Without `mechanics`, in rso, R and the words that are names of members mean other things: there shapes alone count.
    """
    tree = ast.parse(source)
    shapes = SHAPES if mechanics else SHAPES - {"R"}
    said = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)}
    members = {name for s in SETS for name in s.members if mechanics} - OTHERS
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in said:
            if node.value in members:
                yield node.value
            yield from (w for w in re.findall(r"[A-Za-z]+", node.value) if w in shapes)
        names = [getattr(node, key, None) for key in ("id", "attr", "name", "arg", "module")]
        for name in (n for n in names if isinstance(n, str)):
            parts = re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name)
            yield from (p.lower() for p in parts if p.lower() in shapes)
            if mechanics and name == "R" and not isinstance(node, ast.Name):  # a local R is a residual
                yield name


def files() -> list[str]:
    """Every module of both packages outside the folders."""
    found = (p.relative_to(ROOT).as_posix() for name in ("fem_backend", "rso") for p in (ROOT / name).rglob("*.py"))
    return sorted(f for f in found if not (f.startswith("fem_backend/") and f.split("/")[1] in FOLDERS))


@pytest.mark.parametrize("file", files())
def test_no_member_is_named_outside_its_folder(file):
    found = sorted(set(named((ROOT / file).read_text("utf-8"), file.startswith("fem_backend/"))))
    assert (found == []) is (file not in ALLOWED), (file, found)


@pytest.mark.parametrize(
    "source",
    ["if support == 'bowl': pass", "from x import Ellipsoid", "settings.R", "def f(R): pass", "kind = {'fixed': 1}",
     "x = f'below the ball'", "spherical_patch(x)", "law = 'yeoh'"],
)  # fmt: skip
def test_a_name_is_found(source):
    assert list(named(source))


@pytest.mark.parametrize("source", ['"""Of a ball."""', "R = reduced(body, x)  # of a bowl", "x = 'is fixed here'"])
def test_what_is_no_name_is_none(source):
    assert not list(named(source))
