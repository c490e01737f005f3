"""A new member of each open set, defined here alone, is run, checked, documented and offered to a diagnosis."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
from skfem import MeshTet, MeshTet2

from fem_backend import __main__ as door
from fem_backend import members, meshing
from fem_backend.backend import BACKEND
from fem_backend.indenters import INDENTERS
from fem_backend.laws import LAWS, law
from fem_backend.laws.law import Derivatives, Isotropic
from fem_backend.meshing import BadMesh, Mesh
from fem_backend.specimens import SPECIMENS, own_laws
from fem_backend.specimens.specimen import Meshing
from fem_backend.supports import SUPPORTS
from fem_backend.supports.fixed import Fixed
from rso.cli.checking import check_lines
from rso.contract import Case, Programme, knob, run_key
from rso.discrepancy.library.effects import catalogue
from rso.study.errors import StudyError
from rso.study.loader import load_study

# ---------------------------------------------------------------------------------------------------------- members


def made(data: Mapping[str, Any]) -> Mesh:
    """The quarter x, y ≥ 0 of a block, finer below its middle."""
    side = data["half"] * np.array([0.0, 0.06, 0.12, 0.2, 0.32, 0.55, 1.0])
    up = data["height"] * (1.0 - np.array([1.0, 0.6, 0.35, 0.2, 0.09, 0.0]))
    box = MeshTet.init_tensor(side, side, up)
    return Mesh(np.ascontiguousarray(box.p.T), np.ascontiguousarray(box.t.T.astype(np.int64)))


@dataclass(frozen=True)
class Block:
    """|x|, |y| ≤ half, 0 ≤ z ≤ height (mm)."""

    half: float
    height: float

    class Table(members.MemberTable):
        """{ shape = "brick", half = 20.0, height = 15.0 }"""

        shape: Literal["brick"] = "brick"
        half: members.Length = 20.0
        height: members.Length = 15.0

        def build(self) -> Block:
            return Block(self.half, self.height)

    @dataclass(frozen=True)
    class Knobs:
        """The error of its height."""

        delta_brick: float = knob(
            "error of the height",
            "mm",
            -5.0,
            5.0,
            neutral=0.0,
            typical=0.5,
            plausible=(-1.0, 1.0),
            label="wrong height of the block",
        )

    name: ClassVar[str] = "brick"
    gauges: ClassVar[Mapping[str, float]] = {"delta_brick": 0.05}
    makers: ClassVar[Mapping[str, Callable[[Mapping[str, Any]], Mesh]]] = {"toy brick": made}
    smallest_words: ClassVar[str] = "height"
    parts: ClassVar[tuple[str, ...]] = ("upper", "lower")
    of_revolution: ClassVar[bool] = False
    alike: ClassVar[bool] = False
    fattest: ClassVar[float] = math.inf

    smallest = largest = property(lambda self: self.height)
    skin_limit = property(lambda self: 0.5 * self.height)
    top = property(lambda self: np.array([0.0, 0.0, self.height]))
    lowest = property(lambda self: np.zeros(3))
    ratio = property(lambda self: self.height / 15.0)

    def plain(self):
        return {"shape": self.name, "half": self.half, "height": self.height}

    def under(self, indenter):
        return self

    def absent(self):
        return frozenset(("delta_layer", "layer_ratio")) | own_laws.everything()

    def beyond(self, length):
        return 0.0

    laws: ClassVar[tuple] = ()
    ratios: ClassVar[tuple] = ()

    def stiffness(self, X):
        return None

    def layer(self, X):
        return np.zeros(len(X), int)

    def actual(self, knobs):
        return replace(self, height=self.height + knobs.delta_brick)

    def planes(self):
        return True, True

    def dimensions(self):
        return {"delta_brick": self.height}

    def factors(self):
        return {"delta_brick": self.height / 15.0}

    def above(self, x, y):
        return np.array([x, y, self.height]), np.array([0.0, 0.0, 1.0])

    def part(self, name, X):
        return X[:, 2] >= self.height - 1e-9 if name == "upper" else X[:, 2] <= 1e-9

    def distance(self, x):
        return float(x[2] - self.height), np.array([0.0, 0.0, 1.0])

    def closest(self, x):
        return np.array([x[0], x[1], self.height])

    def depth(self, X):
        return self.height - np.asarray(X, float)[..., 2]

    def project(self, x):
        return x.copy()

    def on_surface(self, X):
        return np.abs(X[..., 2] - self.height) < 1e-9

    def mean_curvature(self, x, y):
        return 0.0

    def volume(self):
        return 4.0 * self.half**2 * self.height

    def hole(self, size):
        return np.zeros(3), np.full(3, size)

    def refusal(self, indenter, point):
        return [] if point == (0.0, 0.0) else [f"point = {list(point)} mm: a block is touched in its middle"]

    def beside(self, x, y):
        return None if max(abs(x), abs(y)) <= self.half else f"profile: the mark ({x:g}, {y:g}) mm lies beside it"

    def thickness_along(self, direction):
        return self.height

    def off_top(self, x, y):
        return 0.0

    def meshing(self, length, mesher, level, n, slip):
        recipe = json.dumps({"mesher": "toy brick", "half": self.half, "height": self.height}, sort_keys=True)
        return Meshing(recipe, (("mesher", mesher), ("level", level)), 0.06 * self.half, level)

    def quadratic(self, mesh, recipe, point, planes):
        if planes != (True, True):
            raise BadMesh("a block is meshed as a quarter")
        stretch = np.array([1.0, 1.0, self.height / json.loads(recipe)["height"]])
        return MeshTet2.from_mesh(MeshTet(np.ascontiguousarray((mesh.vertices * stretch).T), mesh.tets.T.copy()))

    def places(self):
        return ()

    def lines(self, point, beside, unit):
        return {"marks on the block": [[point[0] + s, beside] for s in np.linspace(-8.0, 8.0, 9).tolist()]}


@dataclass(frozen=True)
class Paraboloid:
    """g = d·v + |v − (d·v) d|²/2R with v from the tip: rigid, vertical."""

    tip: float

    class Table(members.MemberTable):
        """{ shape = "paraboloid", tip = 4.0 }"""

        shape: Literal["paraboloid"] = "paraboloid"
        tip: members.Length = 4.0

        def build(self) -> Paraboloid:
            return Paraboloid(self.tip)

    @dataclass(frozen=True)
    class Knobs:
        """The error of its radius."""

        delta_tip: float = knob(
            "error of the radius of the tip",
            "mm",
            -2.0,
            2.0,
            neutral=0.0,
            typical=0.1,
            plausible=(-0.4, 0.4),
            label="wrong tip",
        )

    name: ClassVar[str] = "paraboloid"
    noun: ClassVar[str] = "paraboloid"
    theory: ClassVar[str] = "none"
    exponents: ClassVar[tuple[float, ...]] = (1.5,)
    gauges: ClassVar[Mapping[str, float]] = {"delta_tip": 0.02}
    of_revolution: ClassVar[bool] = True

    length = property(lambda self: self.tip)
    size = property(lambda self: ("tip", self.tip))
    finest = property(lambda self: ("tip", self.tip))
    reach = property(lambda self: 2.0 * self.tip)
    cover = property(lambda self: 2.0 * self.tip)
    ratio = property(lambda self: self.tip / 4.0)

    def plain(self):
        return {"shape": self.name, "tip": self.tip}

    def dimensions(self):
        return {"delta_tip": self.tip}

    def actual(self, knobs, specimen):
        return replace(self, tip=self.tip + knobs.delta_tip)

    def planes(self):
        return True, True

    def on(self, specimen):
        return self

    def spacing(self, r):
        return np.clip(0.12 * np.asarray(r), 0.03 * self.tip, None)

    def gap(self, x, centre, direction=(0.0, 0.0, 0.0)):
        d = np.asarray(direction, float)
        v = x - np.asarray(centre, float)
        across = v - (v @ d)[..., None] * d
        g = v @ d + (across**2).sum(-1) / (2.0 * self.tip)
        hessian = np.broadcast_to((np.eye(3) - np.outer(d, d)) / self.tip, (*x.shape, 3))
        return np.ascontiguousarray(g), np.ascontiguousarray(d + across / self.tip), np.ascontiguousarray(hessian)

    def travel(self, x, centre, direction):
        return self.gap(x, centre, direction)[0]

    def swept(self, points, start, end, direction):
        way = end - start
        return self.gap(points, end, way / max(np.linalg.norm(way), 1e-300))[0] < 0.0

    def first_contact(self, specimen, through, direction):
        x, y = through[:2]
        return specimen.above(x, y)[0]

    def contact(self, specimen, touch, direction):
        return touch

    def held(self, points, touch, direction):
        return None

    def normal(self, specimen, touch, direction):
        return specimen.above(*touch[:2])[1]

    def patch(self, surface, x, pressure, centre, axis, planes, attraction, width=np.inf):
        area = 2 ** sum(planes) * float((surface.weights * (pressure > 0.0)).sum())
        return SimpleNamespace(area=area, radius=math.sqrt(area / math.pi), peak=float(pressure.max()))

    def outline(self, centre, direction, across):
        r = np.linspace(-self.tip, self.tip, 41)
        return across @ centre + np.column_stack([r, r**2 / (2.0 * self.tip)])

    def effective_radius(self, curvature):
        return 1.0 / (1.0 / self.tip + curvature)

    def contact_radius(self, depth, curvature):
        return np.sqrt(self.effective_radius(curvature) * depth)

    def force(self, depth, curvature, E, nu):
        return None

    def modulus(self, force, depth, curvature, nu):
        return None

    def adhesive_fit(self, travel, force, curvature):
        return {}

    def strain(self, depth):
        return None

    def tests(self):
        return {"a blunter paraboloid": {"indenter": {"shape": self.name, "tip": 2.0 * self.tip}}}


@dataclass(frozen=True)
class Smooth(Fixed):
    """The part `lower` stays in its plane and is free to slide there: symmetry has to hold the rest."""

    class Table(members.MemberTable):
        """{ kind = "smooth" }"""

        kind: Literal["smooth"] = "smooth"

        def build(self) -> Smooth:
            return Smooth()

    name: ClassVar[str] = "smooth"
    variant: ClassVar[str] = "smooth"
    words: ClassVar[str] = "on a smooth plate"

    def refusal(self, specimen):
        return None if specimen.name == "brick" else f'support.kind = "smooth" carries no {specimen.name}'

    def held(self, specimen, X, surface):
        held = np.zeros(X.shape, bool)
        held[surface[specimen.part("lower", X[surface])], 2] = True
        return held


@dataclass(frozen=True)
class Exponential(Isotropic):
    """W = μ/(2b) (exp b(Ī₁ − 3) − 1) + (J − 1)²/D₁; b = 0 is neo-Hookean (Demiray 1972)."""

    stiffens: float = 0.0

    class Table(law.LawTable):
        """{ law = "exponential" }"""

        law: Literal["exponential"] = "exponential"

    @dataclass(frozen=True)
    class Knobs:
        """b."""

        stiffens: float = knob(
            "exponent b",
            "1",
            0.0,
            10.0,
            neutral=0.0,
            typical=1.0,
            plausible=(0.1, 5.0),
            cause="strain stiffening",
            label="stiffening (exponential)",
        )

    name: ClassVar[str] = "exponential"
    rung: ClassVar[int] = 3
    level: ClassVar[Mapping[str, Any]] = {
        "name": "exponential",
        "title": "exponential",
        "description": "one exponent",
        "open": {"stiffens": (0.0, 2.0)},
        "extends": "neo_hooke",
    }

    def energy(self, i1, i2, J):
        x, b = i1 - 3.0, self.stiffens
        return 0.5 * self.mu * (np.expm1(b * x) / b if b else x) + self.volume_energy(J)

    def derivatives(self, i1, i2, J):
        grown, zero = 0.5 * self.mu * np.exp(self.stiffens * (i1 - 3.0)), np.zeros_like(J)
        return Derivatives(grown, zero, self.stiffens * grown, zero, zero, *self.pressure(J))


TOYS = {
    "specimen": {"shape": "brick", "half": 20.0, "height": 15.0},
    "indenter": {"shape": "paraboloid", "tip": 4.0},
    "support": {"kind": "smooth"},
    "material": {"law": "exponential"},
}
VALUES = {"mu": 0.01, "D1": 5.0, "stiffens": 1.0}


@pytest.fixture
def toys():
    """The four, as `SPECIMENS.register(Block)` and so on make them known, for one test."""
    known = [(s, dict(s.members)) for s in (SPECIMENS, INDENTERS, SUPPORTS, LAWS)]
    makers = dict(meshing.MAKERS)
    for s, toy in ((SPECIMENS, Block), (INDENTERS, Paraboloid), (SUPPORTS, Smooth), (LAWS, Exponential)):
        s.register(toy)
    yield TOYS
    for s, before in known:
        s.members.clear()
        s.members.update(before)
    meshing.MAKERS.clear()
    meshing.MAKERS.update(makers)


def case(settings: Mapping[str, Any], asked: tuple[float, ...] = (0.4, 0.8)) -> Case:
    return Case("toy", Programme.ramp(asked), {"mesh": {"level": "coarse"}, **settings})


# ------------------------------------------------------------------------------------------------------------ tests


def test_toys_are_run_end_to_end(toys):
    """Force grows like that of a paraboloid on a layer, the support gives it back, the law and the knobs count."""
    found = BACKEND(VALUES, case(toys))
    F = found.channels["Fz"]
    assert 2.0**1.3 < F[1] / F[0] < 2.0**2.0
    np.testing.assert_allclose(found.info["reaction_Fz"], F, rtol=1e-6)
    assert np.all(found.channels["Fx"] == 0.0) and np.all(found.error["Fz"] > 0.0)
    assert {"mu", "D1", "stiffens"} <= set(found.gradients)
    softer = BACKEND({**VALUES, "stiffens": 0.0}, case(toys)).channels["Fz"]
    slope = found.gradients["stiffens"]["Fz"]
    assert np.all(softer < F) and np.all(np.abs((F - softer) / slope - 1.0) < 0.5)
    for name, value in (("delta_brick", -2.0), ("delta_tip", 0.5)):
        assert BACKEND({**VALUES, name: value}, case(toys)).channels["Fz"][1] > F[1]
    stuck = BACKEND(VALUES, case({**toys, "support": {"kind": "fixed"}})).channels["Fz"]
    assert stuck[1] > F[1]


def test_toys_mix_with_the_others(toys):
    """A ball on the block, the paraboloid's law under a ball on an ellipsoid: members do not know each other."""
    ball = {"specimen": toys["specimen"], "indenter": {"shape": "sphere", "radius": 4.0}}
    F = BACKEND({"mu": 0.01, "D1": 5.0}, case(ball)).channels["Fz"]
    assert 2.0**1.3 < F[1] / F[0] < 2.0**1.9
    BACKEND.check(case({"material": {"law": "exponential"}}))


def test_toys_have_keys_of_their_own_and_change_no_other(toys):
    plain = case({})
    values, at = BACKEND.canonical({"mu": 0.01, "D1": 5.0}, plain)
    assert "delta_brick" not in values and "stiffens" not in values
    key = run_key(BACKEND, values, at)
    own = run_key(BACKEND, *BACKEND.canonical(VALUES, case(toys)))
    assert own != key
    canonical = BACKEND.canonical(VALUES, case(toys))[1]
    assert run_key(BACKEND, *BACKEND.canonical(VALUES, canonical)) == own
    SPECIMENS.members.pop("brick")
    assert run_key(BACKEND, *BACKEND.canonical({"mu": 0.01, "D1": 5.0}, plain)) == key


def test_toys_stand_in_the_schema(toys, capsys):
    assert door.main(["--schema"]) == 0
    said = json.loads(capsys.readouterr().out)
    settings = said["request"]["case"]["settings"]
    for noun, toy in toys.items():
        assert (toy.get("shape") or toy.get("kind") or toy.get("law")) in settings[noun]
    names = {p["name"] for p in said["parameters"]}
    assert {"delta_brick", "delta_tip", "stiffens", "delta_a"} <= names


def test_wrong_toys_are_refused_all_at_once(toys):
    wrong = {
        "specimen": {"shape": "brik"},
        "indenter": {"shape": "paraboloid", "tip": -1},
        "support": {"kind": "smooth", "x": 1},
    }
    with pytest.raises(ValueError) as refused:
        BACKEND.check(case(wrong))
    lines = str(refused.value).splitlines()
    assert len(lines) == 3
    assert "specimen.shape = 'brik'" in lines[0] and "did you mean 'brick'" in lines[0]
    assert lines[1] == "indenter.tip = -1.0 mm: must be positive" and "support.x = 1: unknown" in lines[2]
    with pytest.raises(ValueError, match="carries no ellipsoid"):
        BACKEND.check(case({"support": {"kind": "smooth"}}))


def test_a_diagnosis_is_offered_the_toys(toys):
    """Other supports that suit the specimen, gauges, tests, marks and levels come from the members."""
    assert set(BACKEND.variants(toys)) == {"held"}
    held = {**toys, "support": {"kind": "fixed"}}
    assert BACKEND.variants(held)["smooth"]["description"] == "on a smooth plate instead of held"
    assert set(BACKEND.variants({})) == {"bowl"}
    assert "paraboloid on the bench" in BACKEND.gauges(toys)["delta_tip"][0] and "delta_brick" in BACKEND.gauges(toys)
    assert "a blunter paraboloid" in BACKEND.tests(toys) and "marks on the block" in BACKEND.marks(toys)
    levels = BACKEND.levels(toys)
    assert [one["name"] for one in levels[0]] == ["linear_elastic"]  # no closed form for a paraboloid
    assert "exponential" in [one["name"] for one in levels[-1]]
    known = {p.name: p for p in BACKEND.parameters}
    assert known["delta_brick"].label == "wrong height of the block" and known["stiffens"].cause == "strain stiffening"
    assert BACKEND.cost({"mu": 0.01, "D1": 5.0}, case(toys)) > 0.0


def test_a_diagnosis_tries_the_toys_that_are_there(toys):
    """Their knobs are hypotheses beside them, and no hypotheses beside others; so are those of others beside them."""

    def labels(settings: Mapping[str, Any]) -> set[str]:
        return {e.label for e in catalogue(BACKEND, settings, {}, ("mu", "D1"))}

    here, elsewhere = labels({**toys, "support": {"kind": "fixed"}, "material": {}}), labels({})
    own = {"wrong height of the block", "wrong tip"}
    others = {"on a smooth plate instead of held", "stiffening (exponential)", "friction under the indenter"}
    assert own | others <= here
    assert not {"wrong semi-axis a", "wrong ball radius", "in a bowl instead of held"} & here
    assert not own & elsewhere and "wrong semi-axis a" in elsewhere


STUDY = """
[study]
title = "Toys"
seed = 1
[backend]
use = "fem_backend.backend:BACKEND"
[backend.settings]
specimen = {{ shape = "{shape}" }}
indenter = {{ shape = "paraboloid", tip = {tip} }}
support = {{ kind = "smooth" }}
material = {{ law = "exponential" }}
[parameters]
mu = {{ low = "6 kPa", high = "15 kPa" }}
D1 = {{ value = 5.0 }}
stiffens = {{ low = 0.1, high = 2.0 }}
[[experiments]]
name = "middle"
role = "fit"
data = "middle.csv"
noise = {{ Fz = "0.1 mN", contact = "0 mm" }}
[doe]
runs = 16
"""


def study(folder, shape: str = "brick", tip: float = 4.0):
    """A study of toys, written and read."""
    depth = np.linspace(0.0, 1.0, 21)
    rows = "\n".join(f"{d:.4f},{0.1 * d**1.5:.6f}" for d in depth)
    (folder / "middle.csv").write_text(f"depth_mm,Fz_N\n{rows}\n")
    (folder / "study.toml").write_text(STUDY.format(shape=shape, tip=tip))
    return load_study(folder / "study.toml")


def test_toys_stand_in_a_check(toys, tmp_path):
    said = "\n".join(check_lines(study(tmp_path), tmp_path / "results", False))
    for words in ('specimen.shape = "brick"', "indenter.tip = 4.0", 'support.kind = "smooth"', "stiffens"):
        assert words in said
    with pytest.raises(StudyError) as refused:
        check_lines(study(tmp_path, "brik", -1.0), tmp_path / "results", False)
    assert len(refused.value.problems) == 2  # both at once, each with its line
    assert any("did you mean 'brick'" in p for p in refused.value.problems)
    assert any("indenter.tip = -1.0 mm" in p for p in refused.value.problems)
