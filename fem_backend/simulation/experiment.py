"""What an experiment is beside its numbers: shapes, support, law, place, mesh.

A setting or a value that this backend does not model is refused by name; it is never ignored.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from fem_backend import meshing
from fem_backend.geometry import Ellipsoid
from fem_backend.solver.load_steps import Control
from fem_backend.supports import SUPPORTS, Support
from rso.contract import finite

LIMIT = "limit"  # the mesh level whose forces are extrapolated, see fem_backend.accuracy.two_grid
LARGEST = 70  # semi-axis over the radius of the ball: of one three times as large fTetWild makes no sound mesh
# Of canonical settings, raised when answers change where misalignment or tilt takes the fine elements along, those of
# loose bodies that may turn and whose way there matters, and those of `backend.mended`: no study states them.
MARKS = {"follows": 1, "rolling": 3, "mended": 2}
OF_A_MESHER = {"tetwild": ("level",), "mapped": ("n", "slip")}  # keys of the mesh that only one of them has
LAWS = ("neo_hookean", "linear_elastic", "mooney_rivlin", "yeoh", "ogden")


@dataclass(frozen=True)
class Settings:
    """An indentation experiment without its numbers; lengths in mm.

    `recipe` is that of the mesh, `mesh` the mesh table with the keys that count, `h0` the element size at the contact;
    `profile` are reference places (x, y) of surface points whose displacement is asked for; `earlier` is the deepest
    travel at this place before the test (softening); `ogden` are (alpha, share) of further terms, `prony` (g, tau);
    `derivatives` says whether those by the material knobs are wanted, `multipliers` whether the contact is exact or a
    penalty whose softness is taken out of the forces to first order.
    """

    body: Ellipsoid
    R: float
    shaft: bool = False
    support: Support = field(default_factory=lambda: SUPPORTS.members[SUPPORTS.default]())
    law: str = "neo_hookean"
    ogden: tuple[tuple[float, float], ...] = ()
    prony: tuple[tuple[float, float], ...] = ()
    point: tuple[float, float] = (0.0, 0.0)
    direction: str = "vertical"
    cavity: tuple[float, float, float] = (15.0, 10.0, 10.0)
    profile: tuple[tuple[float, float], ...] = ()
    earlier: float = 0.0
    recipe: str = ""
    mesh: tuple[tuple[str, Any], ...] = ()
    h0: float = 0.0
    level: str = ""
    control: Control = field(default_factory=Control)
    solver: str = "auto"
    defaults: tuple[tuple[str, float], ...] = ()  # knobs that the settings set
    derivatives: bool = True
    multipliers: bool = True


def read_settings(settings: Mapping[str, Any]) -> Settings:
    """Settings from plain data; raises ValueError naming key, value and choices."""
    data = dict(settings)
    specimen = _table(data, "specimen", {"shape": "ellipsoid", "semi_axes": [60.0, 35.0, 35.0], "cavity": None},
                      "mended")  # fmt: skip
    _choice("specimen.shape", specimen["shape"], ["ellipsoid"])
    body = Ellipsoid(*_lengths("specimen.semi_axes", specimen["semi_axes"], 3))
    hollow = [body.a / 4.0, body.b / 3.5, body.c / 3.5] if specimen["cavity"] is None else specimen["cavity"]
    cavity = tuple(_lengths("specimen.cavity", hollow, 3))
    indenter = _table(data, "indenter", {"shape": "sphere", "radius": 3.0, "shaft": False})
    _choice("indenter.shape", indenter["shape"], ["sphere"])
    R = _lengths("indenter.radius", [indenter["radius"]], 1)[0]
    if R > 0.5 * float(body.semi_axes.min()):
        most = f"at most {0.5 * float(body.semi_axes.min()):g} mm (half of its smallest semi-axis)"
        raise ValueError(
            f"indenter.radius = {R} mm: only indenters much smaller than the specimen are modelled, {most}"
        )
    if R < float(body.semi_axes.max()) / LARGEST:
        least = f"at least {float(body.semi_axes.max()) / LARGEST:.3g} mm (1/{LARGEST} of its largest semi-axis)"
        raise ValueError(
            f"indenter.radius = {R} mm: no mesh is made for so small a ball on this specimen, {least}; "
            "it takes a smaller specimen for the same half-space"
        )
    shaft = _flag("indenter.shaft", indenter["shaft"])
    support = SUPPORTS.read(data.pop("support", {}))
    if refusal := support.refusal(body):
        raise ValueError(refusal)
    law, ogden, prony = _material(data)
    point = tuple(_numbers("point", data.pop("point", [0.0, 0.0]), 2))
    if math.hypot(point[0] / body.a, point[1] / body.b) > meshing.FARTHEST:
        raise ValueError(
            f"point = {list(point)} mm: off the top by at most {meshing.FARTHEST:g} of the semi-axes is modelled"
        )
    direction = _choice("direction", data.pop("direction", "vertical"), ["vertical", "normal"])
    _speed(data.pop("speed", 1.0))  # the programme carries the times
    _flag("unload", data.pop("unload", False))
    profile = data.pop("profile", [])
    if not isinstance(profile, list | tuple):
        raise ValueError(f"profile = {profile!r}: a list of [x, y] in mm is expected")
    places = tuple(tuple(_numbers("profile", p, 2)) for p in profile)
    for x, y in places:
        if math.hypot(x / body.a, y / body.b) > 1.0:
            raise ValueError(f"profile: the mark ({x:g}, {y:g}) mm lies beside the specimen, whose semi-axes are "
                             f"{body.a:g} and {body.b:g} mm")  # fmt: skip
    _distinct(places)
    earlier = _numbers("earlier", [data.pop("earlier", 0.0)], 1)[0]
    if earlier < 0:
        raise ValueError(f"earlier = {earlier} mm: the deepest travel before this test, at least 0")
    plain = {"mesher": "tetwild", "level": "standard", "n": 12, "slip": 0.55}
    _apart(data.get("mesh"))
    mesh = _table(data, "mesh", plain, "follows")
    solver = _choice("solver", data.pop("solver", "auto"), ["auto", "pardiso", "superlu"])
    derivatives = _flag("derivatives", data.pop("derivatives", True))
    multipliers = _flag("multipliers", data.pop("multipliers", True))
    if data:
        known = "specimen, indenter, support, material, point, direction, speed, unload, profile, earlier, mesh, "
        known += "solver, derivatives, multipliers"
        raise ValueError(f"unknown setting {sorted(data)[0]!r}; {_choose(sorted(data)[0], known.split(', '))}")
    recipe, used, h0, level = _mesh(body, R, mesh)
    control = Control().scaled(R)
    return Settings(
        body, R, shaft, support, law, ogden, prony, point, direction, cavity, places, earlier,
        recipe, used, h0, level, control if multipliers else control.soft(), solver,
        tuple(support.defaults().items()), derivatives, multipliers,
    )  # fmt: skip


def profile_name(place: tuple[float, float]) -> str:
    """Channel of the vertical displacement (mm, up) of the surface point above the reference place (x, y) mm."""
    return f"uz({place[0]:g},{place[1]:g})"


def plain_settings(settings: Settings) -> dict[str, Any]:
    """What of the settings can change an answer, as plain data with all defaults written out."""
    return {
        "specimen": {"shape": "ellipsoid", "semi_axes": settings.body.semi_axes.tolist(),
                     "cavity": list(settings.cavity)},
        "indenter": {"shape": "sphere", "radius": settings.R, "shaft": settings.shaft},
        "support": settings.support.plain(),
        "material": {"law": settings.law, "ogden": [list(t) for t in settings.ogden],
                     "prony": [list(t) for t in settings.prony]},
        "point": list(settings.point),
        "direction": settings.direction,
        "profile": [list(p) for p in settings.profile],
        "earlier": settings.earlier,
        "mesh": dict(settings.mesh),
        **({} if settings.multipliers else {"multipliers": False}),
    }  # fmt: skip


def _distinct(places: Sequence[tuple[float, float]]) -> None:
    """Each mark has a channel of its own."""
    names = [profile_name(p) for p in places]
    twice = [(p, n) for k, (p, n) in enumerate(zip(places, names, strict=True)) if n in names[:k]]
    if twice:
        (x, y), name = twice[0]
        first = places[names.index(name)]
        raise ValueError(f"profile: the marks {list(first)} and [{x!r}, {y!r}] mm would share the channel {name}; "
                         "marks differ in their first six digits")  # fmt: skip


def _material(data: dict[str, Any]) -> tuple[str, tuple, tuple]:
    table = _table(data, "material", {"law": "neo_hookean", "ogden": [], "prony": []})
    law = _choice("material.law", table["law"], LAWS)
    terms = {}
    for key, what in (("ogden", "[alpha, share of mu]"), ("prony", "[g, tau in s]")):
        if not isinstance(table[key], list | tuple):
            raise ValueError(f"material.{key} = {table[key]!r}: a list of {what} is expected")
        terms[key] = tuple(tuple(_numbers(f"material.{key}", t, 2)) for t in table[key])
    if len(terms["ogden"]) > 2:
        raise ValueError("material.ogden: at most two further terms (N <= 3)")
    if terms["ogden"] and law != "ogden":
        raise ValueError(f'material.ogden is given but law = "{law}"; set law = "ogden"')
    if any(a == 0 for a, _ in terms["ogden"]) or sum(s for _, s in terms["ogden"]) >= 1:
        raise ValueError(
            f"material.ogden = {_plain(terms['ogden'])}: exponents must not be 0 and the shares must sum to less than 1"
        )
    if any(g < 0 or tau <= 0 for g, tau in terms["prony"]) or sum(g for g, _ in terms["prony"]) >= 1:
        raise ValueError(
            f"material.prony = {_plain(terms['prony'])}: g >= 0, tau > 0 and a sum of g below 1 are needed"
        )
    return law, terms["ogden"], terms["prony"]


def _mesh(body: Ellipsoid, R: float, mesh: Mapping[str, Any]) -> tuple[str, tuple[tuple[str, Any], ...], float, str]:
    """Recipe, the keys that count, element size at the contact and name of the level."""
    mesher = _choice("mesh.mesher", mesh["mesher"], ["tetwild", "mapped"])
    n, level = mesh["n"], _choice("mesh.level", mesh["level"], [*meshing.LEVELS, LIMIT])
    if not isinstance(n, int) or isinstance(n, bool) or not 4 <= n <= 40:
        raise ValueError(f"mesh.n = {n!r}: number of subdivisions, an integer from 4 to 40")
    slip = _numbers("mesh.slip", [mesh["slip"]], 1)[0]
    if not 0.0 <= slip <= 0.8:
        raise ValueError(f"mesh.slip = {slip}: grading of the mapped mesh, from 0 to 0.8")
    if mesher == "mapped":
        h0 = 0.5 * math.pi * body.c / n * (1.0 - slip) / (1.0 + slip)
        used = (("mesher", mesher), ("n", n), ("slip", slip))
        return meshing.mapped_recipe(body, n, slip), used, float(h0), ""
    made = "reference" if level == LIMIT else level  # its forces are extrapolated from that mesh and the coarse one
    h0 = meshing.LEVELS[made].h0 * (R / meshing.RADIUS)
    used = (("mesher", mesher), ("level", level))
    if meshing.template_fits(body, R):
        return meshing.template_recipe(made, body), used, h0, level
    if level == LIMIT:
        raise ValueError(f"mesh.level = {LIMIT!r}: only for specimens and indenters that the shipped meshes fit")
    # similar specimens share one mesh, made for the ball that the levels are tuned for: the mesher knows millimetres
    similar = Ellipsoid(*(float(f"{v:.12g}") for v in body.semi_axes * (meshing.RADIUS / R)))
    sizing = replace(meshing.LEVELS[made], hmax=1.15 * float(similar.semi_axes.min()))
    return meshing.tetwild_recipe(similar, sizing), used, h0, level


def _apart(mesh: object) -> None:
    """A key of the other mesher would be ignored."""
    if not isinstance(mesh, Mapping) or mesh.get("mesher", "tetwild") not in [*OF_A_MESHER]:
        return
    mesher = mesh.get("mesher", "tetwild")
    for other, keys in OF_A_MESHER.items():
        alien = [k for k in keys if other != mesher and k in mesh]
        if alien:
            key = alien[0]
            raise ValueError(
                f'mesh.{key} = {mesh[key]!r} is for mesher = "{other}" and would be ignored by "{mesher}", '
                f"which has {', '.join(OF_A_MESHER[mesher])}"
            )


def _plain(terms: tuple) -> list[list[float]]:
    return [list(t) for t in terms]


def _speed(value: object) -> None:
    written = None
    if isinstance(value, str):
        written = re.fullmatch(r"\s*(\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)\s*mm/(?:s|min)\s*", value)
    number = float(written[1]) if written else value
    if not finite(number) or number <= 0:
        raise ValueError(f'speed = {value!r}: a positive speed such as "30 mm/min", or a number in mm/s')


def _table(data: dict[str, Any], name: str, defaults: dict[str, Any], mark: str = "") -> dict[str, Any]:
    """A table with its defaults; its `mark` is passed over as the backend writes it and unknown otherwise."""
    value = data.pop(name, {})
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} = {value!r}: a table with the keys {', '.join(defaults)} is expected")
    if type(value.get(mark)) is int and 1 <= value[mark] <= MARKS[mark]:  # stored runs may have an earlier one
        value = {k: v for k, v in value.items() if k != mark}
    unknown = sorted(set(value) - set(defaults))
    if unknown:
        text = f"{name}.{unknown[0]} = {value[unknown[0]]!r}: unknown"
        raise ValueError(f"{text}; {_choose(unknown[0], list(defaults))}")
    return {**defaults, **value}


def _choice(name: str, value: object, choices: object) -> str:
    options = [str(c) for c in choices]  # type: ignore[attr-defined]
    if value not in options:
        raise ValueError(f"{name} = {value!r} is not modelled; {_choose(str(value), options)}")
    return str(value)


def _choose(word: str, choices: Sequence[str]) -> str:
    """The nearest choice, if one is near, and all of them."""
    near = difflib.get_close_matches(word, choices, n=1)
    return f"{f'did you mean {near[0]!r}? ' if near else ''}choose from {', '.join(choices)}"


def _flag(name: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"{name} = {value!r}: true or false is expected")
    return value


def _numbers(name: str, value: object, count: int) -> list[float]:
    good = isinstance(value, list | tuple) and len(value) == count
    if not good or not all(map(finite, value)):
        text = any(isinstance(v, str) for v in value) if good else isinstance(value, str)
        plain = ", without quotes and units: lengths are in mm" if text else ""
        shown = value[0] if good and count == 1 else value
        raise ValueError(f"{name} = {shown!r}: {count} finite number(s) expected{plain}")
    return [float(v) for v in value]


def _lengths(name: str, value: object, count: int) -> list[float]:
    numbers = _numbers(name, value, count)
    if min(numbers) <= 0:
        raise ValueError(f"{name} = {numbers[0] if count == 1 else numbers} mm: must be positive")
    return numbers
