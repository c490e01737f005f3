"""What an experiment is beside its numbers: specimen, indenter, support, law, place, mesh.

A setting or a value that this backend does not model is refused by name; it is never ignored.  The tables of the four
open sets are discriminated unions of what their members declare.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, TypeAdapter, ValidationError, create_model, model_validator

from fem_backend import members, meshing
from fem_backend.indenters import INDENTERS, Indenter
from fem_backend.laws import LAWS
from fem_backend.laws.law import canonical_law as law_table
from fem_backend.materials.permeability import HolmesMow
from fem_backend.members import OpenSet, refused
from fem_backend.meshing import LIMIT_LEVEL
from fem_backend.solver.load_steps import Control
from fem_backend.specimens import SPECIMENS, OfOnePlace, Specimen
from fem_backend.supports import SUPPORTS, Support

# Of canonical settings, raised when answers change where misalignment or tilt takes the fine elements along, those of
# loose bodies that may turn and whose way there matters, and those of `backend.mended`: no study states them.
MESH_MARKS = {"follows": 1, "large_strain": 1}
MARKS = {**MESH_MARKS, **SUPPORTS.marks, **SPECIMENS.marks}
# lengths of the indenter: travel from which large strains need another element and mesh
LARGE_STRAIN_TRAVEL_RATIO = 2.0
LARGE_STRAIN_THICKNESS_SHARE = 0.6  # of the thickness: the same of thin specimens
MESHER_KEYS = {"tetwild": ("level",), "mapped": ("n", "slip")}  # keys of the mesh that only one of them has
SEALED, POROUS = DRAINAGE = "sealed", "porous"
# radius at an edge over the element size: at 0.4 a flat end finds its equilibria, at 0.2 not all
MIN_EDGE_RADIUS_RATIO = 0.35
SMOOTH_REMESHING_TRAVEL_RATIO, EDGED_REMESHING_TRAVEL_RATIO = 1.5, 0.1  # lengths of the indenter, see `remeshed_from`
REMESHING_CHOICES = ("when_needed", "never")  # when the mesh of a meridian is made anew
SETS: dict[str, OpenSet] = {s.noun: s for s in (SPECIMENS, INDENTERS, SUPPORTS, LAWS)}


@dataclass(frozen=True)
class Settings:
    """An indentation experiment without its numbers; lengths in mm.

    `recipe` is that of the mesh, `mesh` the mesh table with the keys that count, `h0` the element size at the contact;
    `profile` are reference places (x, y) of surface points whose displacement is asked for; `earlier` is the deepest
    travel at this place before the test (softening); `terms` are (alpha, share) of further terms of the law, `prony`
    (g, tau); `derivatives` says whether those by the material knobs are wanted, `multipliers` whether the contact is
    exact or a penalty whose softness is taken out of the forces to first order; `defaults` are knobs that tables set;
    `fineness` multiplies all element sizes of a meridian, which are at most fine[0] within fine[1] (mm) of the axis;
    `remesh` says whether its mesh is remade where it is outworn; `drainage` are those under the indenter and at the
    support, `closes` is how the permeability falls as pores close; `large_strain` says that mesh and element in
    space are those of deep indentations, see `for_travel`.
    """

    specimen: Specimen
    indenter: Indenter
    support: Support = field(default_factory=lambda: SUPPORTS.read({}))
    law: str = LAWS.default
    terms: tuple[tuple[float, float], ...] = ()
    prony: tuple[tuple[float, float], ...] = ()
    point: tuple[float, float] = (0.0, 0.0)
    direction: str = "vertical"
    profile: tuple[tuple[float, float], ...] = ()
    earlier: float = 0.0
    recipe: str = ""
    mesh: tuple[tuple[str, Any], ...] = ()
    h0: float = 0.0
    level: str = ""
    control: Control = field(default_factory=Control)
    solver: str = "auto"
    defaults: tuple[tuple[str, float], ...] = ()
    derivatives: bool = True
    multipliers: bool = True
    fineness: float = 1.0
    fine: tuple[float, float] | None = None
    remesh: str = "when_needed"
    drainage: tuple[str, str] = (SEALED, SEALED)
    closes: HolmesMow = field(default_factory=HolmesMow)
    large_strain: bool = False


# ----------------------------------------------------------------------------------------------------------- tables


def _subdivisions(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 4 <= value <= 40:
        raise refused(": number of subdivisions, an integer from 4 to 40")
    return value


def _slip(value: Any) -> float:
    if not 0.0 <= members.finite_number(value) <= 0.8:
        raise refused(": grading of the mapped mesh, from 0 to 0.8")
    return float(value)


def _speed(value: Any) -> Any:
    """The programme carries the times: a speed is only checked."""
    written = None
    if isinstance(value, str):
        written = re.fullmatch(r"\s*(\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)\s*mm/(?:s|min)\s*", value)
    number = float(written[1]) if written else value
    if not members.is_finite(number) or number <= 0:
        raise refused(': a positive speed such as "30 mm/min", or a number in mm/s')
    return value


def _places(value: Any) -> tuple[tuple[float, float], ...]:
    if not isinstance(value, list | tuple):
        raise refused(": a list of [x, y] in mm is expected")
    return tuple((x, y) for x, y in map(members.numbers(2), value))


def _earlier(value: Any) -> float:
    if members.finite_number(value) < 0:
        raise refused(" mm: the deepest travel before this test, at least 0", value=float(value))
    return float(value)


def _at_least_zero(value: Any) -> float:
    if members.finite_number(value) < 0:
        raise refused(": a number, at least 0")
    return float(value)


def _share(value: Any) -> float:
    if not 0.0 <= members.finite_number(value) < 1.0:
        raise refused(": a share of the volume, from 0 to below 1")
    return float(value)


class MeshTable(members.MemberTable):
    """mesh: who makes it and how fine it is."""

    mesher: Annotated[str, BeforeValidator(members.one_of(("tetwild", "mapped")))] = "tetwild"
    """tetwild: graded at the contact; mapped: the same to the bit everywhere."""
    level: Annotated[str, BeforeValidator(members.one_of((*meshing.TEMPLATE_SIZINGS, LIMIT_LEVEL)))] = "standard"
    """coarse | standard | fine | reference | limit, of tetwild."""
    n: Annotated[int, BeforeValidator(_subdivisions)] = 12
    """Subdivisions of the mapped mesh."""
    slip: Annotated[float, BeforeValidator(_slip)] = 0.55
    """Grading of the mapped mesh."""
    remesh: Annotated[str, BeforeValidator(members.one_of(REMESHING_CHOICES))] = "when_needed"
    """when_needed | never: whether the mesh of a body of revolution is remade where it is worn out."""

    @model_validator(mode="before")
    @classmethod
    def _own(cls, value: Any) -> Any:
        """The table without the backend's mark; a key of the other mesher would be ignored."""
        if not isinstance(value, Mapping):
            raise refused(f": a table with the keys {', '.join(cls.model_fields)} is expected")
        known = {name: MARKS[name] for name in MESH_MARKS}
        value = {k: v for k, v in value.items() if not members.is_revision_mark(k, v, known)}
        mesher = value.get("mesher", "tetwild")
        for other, keys in MESHER_KEYS.items() if isinstance(mesher, str) and mesher in MESHER_KEYS else ():
            for key in (k for k in keys if other != mesher and k in value):
                raise refused(
                    f' is for mesher = "{other}" and would be ignored by "{mesher}", which has '
                    f"{', '.join(MESHER_KEYS[mesher])}",
                    key,
                    value[key],
                )
        return value


class HolmesMowTable(members.MemberTable):
    """drainage.holmes_mow: k/k₀ = ((J − φ)/(1 − φ))^alpha · exp(M (J² − 1)/2), φ the solid fraction."""

    M: Annotated[float, BeforeValidator(_at_least_zero)] = 0.0
    """How fast the permeability falls with the volume, at least 0."""
    alpha: Annotated[float, BeforeValidator(_at_least_zero)] = 0.0
    """Power of the share of pores that is left, at least 0."""
    solid_fraction: Annotated[float, BeforeValidator(_share)] = 0.0
    """Share of the volume that is solid before deformation, 0 to below 1."""


class DrainageTable(members.MemberTable):
    """drainage: where liquid leaves a body with pore flow; all of its surface that nothing touches is open."""

    indenter: Annotated[str, BeforeValidator(members.one_of(DRAINAGE))] = SEALED
    """sealed: no liquid passes where the indenter touches; porous: as where nothing does."""
    support: Annotated[str, BeforeValidator(members.one_of(DRAINAGE))] = SEALED
    """sealed | porous, of all that the support holds or may touch."""
    holmes_mow: HolmesMowTable = HolmesMowTable()
    """How the permeability falls as pores close; constant without."""


class SettingsTable(members.MemberTable):
    """The settings of one experiment beside the tables of the open sets."""

    point: Annotated[tuple[float, float], BeforeValidator(members.numbers(2)), members.read_in("mm")] = (0.0, 0.0)
    """Where the axis of the indenter meets the specimen, (x, y) mm."""
    direction: Annotated[Literal["vertical", "normal"], BeforeValidator(members.one_of(("vertical", "normal")))] = (
        "vertical"
    )
    """The way of the indenter."""
    speed: Annotated[Any, BeforeValidator(_speed), members.read_in("mm/s")] = 1.0
    """Not used: the programme carries the times."""
    unload: members.Flag = False
    """Not used: the programme has the unloading."""
    profile: Annotated[tuple[tuple[float, float], ...], BeforeValidator(_places), members.read_in("mm")] = ()
    """Surface marks (x, y) mm whose vertical displacement is asked for."""
    earlier: Annotated[float, BeforeValidator(_earlier), members.read_in("mm")] = 0.0
    """Deepest travel at this place before the test (softening), mm."""
    mesh: MeshTable = MeshTable()
    """The mesh."""
    drainage: DrainageTable = DrainageTable()
    """Where liquid leaves a body with pore flow."""
    solver: Annotated[str, BeforeValidator(members.one_of(("auto", "pardiso", "superlu")))] = "auto"
    """auto | pardiso | superlu."""
    derivatives: members.Flag = True
    """Those by the material knobs: a sixth to a third of an elastic run."""
    multipliers: members.Flag = True
    """Exact contact, or a penalty corrected to first order, faster and without derivatives."""


def settings_model() -> type[members.MemberTable]:
    """The pydantic model of all settings, with the members that are registered now."""
    return _table(tuple(tuple(s.members.items()) for s in SETS.values()))


@functools.lru_cache(maxsize=16)
def _table(now: tuple) -> type[members.MemberTable]:
    """One model as long as the members `now` are the same."""
    unions = {noun: (Annotated[Any, s], field_of(s)) for noun, s in SETS.items()}
    made = create_model("ExperimentSettings", __base__=SettingsTable, **unions)
    made.__doc__ = "Settings of an experiment; every table of an open set is one of those of its members."
    return made


def unit_of_setting(keys: Sequence[str]) -> str | None:
    """The unit that the numbers of a setting are in, by its keys (specimen, thickness), "1" of a pure number.

    None for what is no number or no setting.  Tables of all members of an open set count.
    """
    every = settings_schema(settings_model())
    found = [unit for node in _properties(every, every, tuple(keys)) for unit in _units(every, node)]
    return next(iter(found), None)


@functools.lru_cache(maxsize=16)
def settings_schema(model: type[members.MemberTable]) -> dict[str, Any]:
    """The JSON schema of settings."""
    return model.model_json_schema()


def _resolved(whole: Mapping[str, Any], node: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """What a node of a schema stands for, and all of its alternatives."""
    if "$ref" in node:
        yield from _resolved(whole, whole["$defs"][node["$ref"].rpartition("/")[2]])
    yield node
    for kind in ("anyOf", "oneOf", "allOf"):
        for one in node.get(kind, ()):
            yield from _resolved(whole, one)


def _properties(
    whole: Mapping[str, Any], node: Mapping[str, Any], keys: tuple[str, ...]
) -> Iterator[Mapping[str, Any]]:
    """Nodes of a schema at these keys, those of alternatives one after the other."""
    if not keys:
        yield node
        return
    for one in _resolved(whole, node):
        if keys[0] in one.get("properties", {}):
            yield from _properties(whole, one["properties"][keys[0]], keys[1:])


def _units(whole: Mapping[str, Any], node: Mapping[str, Any]) -> Iterator[str]:
    every = list(_resolved(whole, node))
    yield from (one["unit"] for one in every if "unit" in one)
    yield from ("1" for one in every if one.get("type") in ("number", "integer"))


def field_of(open_set: OpenSet) -> Any:
    """The default of a union: the default member with its own defaults."""
    return open_set.members[open_set.default].Table()


@functools.lru_cache(maxsize=16)
def _validator(model: type[members.MemberTable]) -> TypeAdapter:
    return TypeAdapter(model)


def read_settings(settings: Mapping[str, Any]) -> Settings:
    """Settings from plain data; ValueError with every problem, one a line, naming key, value and choices."""
    try:
        text = json.dumps(settings, sort_keys=True)
    except (TypeError, ValueError):  # not plain data: whoever reads it says what is wrong
        return _read(settings_model(), settings)
    return _read_again(settings_model(), text, members.stamps_of(text, settings))


@functools.lru_cache(maxsize=1024)
def _read_again(model: Any, text: str, stamps: tuple[tuple[str, int, int], ...]) -> Settings:
    """A study asks for a few settings thousands of times; they are frozen, and what is wrong is not kept."""
    return _read(model, json.loads(text))


def _read(model: Any, settings: Mapping[str, Any]) -> Settings:
    known = {(): [*SETS, *SettingsTable.model_fields], ("mesh",): [*MeshTable.model_fields]}
    known["drainage",] = [*DrainageTable.model_fields]
    known["drainage", "holmes_mow"] = [*HolmesMowTable.model_fields]
    try:
        read = _validator(model).validate_python(dict(settings))
    except ValidationError as error:
        raise ValueError("\n".join(members.problems(error, SETS, (), known))) from error
    made = {noun: getattr(read, noun).build() for noun in SETS}
    made[SPECIMENS.noun] = made[SUPPORTS.noun].confines(made[SPECIMENS.noun])
    made[INDENTERS.noun] = made[INDENTERS.noun].on(made[SPECIMENS.noun])
    wrong = check_combinations(made, read)
    if wrong:
        raise ValueError("\n".join(wrong))
    return _settings(made, read)


def check_combinations(made: Mapping[str, Any], read: Any) -> list[str]:
    """What cannot be together, though each is right by itself."""
    specimen, wrong = made["specimen"], []
    wrong += specimen.refusal(made["indenter"], read.point)
    wrong += filter(None, [made["support"].refusal(specimen)])
    wrong += filter(None, [specimen.beside(x, y) for x, y in read.profile])
    return wrong + _distinct(read.profile)


def _settings(made: Mapping[str, Any], read: Any) -> Settings:
    specimen, indenter, support = (made[noun] for noun in ("specimen", "indenter", "support"))
    mesh, material = read.mesh, made["material"]
    specimen = specimen.under(indenter)
    if isinstance(specimen, OfOnePlace):
        specimen = specimen.touched_at(read.point)
    meshed = specimen.meshing(indenter.length, mesh.mesher, mesh.level, mesh.n, mesh.slip)
    key, bends = indenter.finest
    # a meridian is as fine as the indenter wants it
    if not specimen.of_revolution and bends < MIN_EDGE_RADIUS_RATIO * meshed.h0:
        raise ValueError(
            f"indenter.{key}: elements of {meshed.h0:.3g} mm at the contact cannot resolve a radius of {bends:.3g} "
            f"mm. Use at least {1.006 * MIN_EDGE_RADIUS_RATIO * meshed.h0:.3g} mm, or a finer mesh"
        )
    control = Control().scaled(indenter.length)
    return Settings(
        specimen,
        indenter,
        support,
        material.law,
        material.ogden,
        material.prony,
        read.point,
        read.direction,
        read.profile,
        read.earlier,
        meshed.recipe,
        meshed.used if mesh.remesh == MeshTable().remesh else (*meshed.used, ("remesh", mesh.remesh)),
        meshed.h0,
        meshed.level,
        control if read.multipliers else control.soft(),
        read.solver,
        tuple(support.defaults().items()),
        read.derivatives,
        read.multipliers,
        meshed.fineness,
        remesh=mesh.remesh,
        drainage=(read.drainage.indenter, read.drainage.support),
        closes=HolmesMow(**dict(read.drainage.holmes_mow)),
    )


def for_travel(settings: Settings, deepest: float) -> Settings:
    """The settings for travels to `deepest` (mm): beyond 2 lengths or 0.6 of the thickness those of large strain.

    Not of the level limit, whose extrapolation is that of one family of meshes.
    """
    down = np.array([0.0, 0.0, -1.0])
    way = -settings.specimen.above(*settings.point)[1] if settings.direction == "normal" else down
    least = min(
        LARGE_STRAIN_TRAVEL_RATIO * settings.indenter.length,
        LARGE_STRAIN_THICKNESS_SHARE * settings.specimen.thickness_along(way),
    )
    return replace(settings, large_strain=deepest > least and settings.level != LIMIT_LEVEL)


def with_multipliers(settings: Settings) -> Settings:
    """The same with exact contact."""
    if settings.multipliers:
        return settings
    return replace(settings, multipliers=True, control=Control().scaled(settings.indenter.length))


def on_axis(settings: Settings) -> bool:
    """Whether the meridian alone is modelled as long as no knob tilts, moves or reinforces anything."""
    round_ = all(m.of_revolution for m in (settings.specimen, settings.indenter, settings.support))
    return round_ and (settings.specimen.alike or settings.point == (0.0, 0.0))


def remeshed_from(settings: Settings) -> float:
    """Travel (mm) up to which no mesh is remade: 1.5 lengths of a smooth indenter, 0.1 of one with an edge."""
    if settings.remesh == "never" or not on_axis(settings) or not settings.multipliers:
        return np.inf
    return watched_from(settings)


def watched_from(settings: Settings) -> float:
    """The same where a mesh is only looked at."""
    smooth = np.isinf(settings.indenter.finest[1])
    return (SMOOTH_REMESHING_TRAVEL_RATIO if smooth else EDGED_REMESHING_TRAVEL_RATIO) * settings.indenter.length


def element_size(settings: Settings, meridian: bool) -> float:
    """Size (mm) of the smallest elements at the contact, of a meridian or in space."""
    if not meridian:
        return settings.h0
    own = float(settings.indenter.spacing(np.zeros(1))[0])
    return settings.fineness * (own if settings.fine is None else min(own, settings.fine[0]))


def profile_name(place: tuple[float, float], axis: str = "z") -> str:
    """Channel of the displacement (mm) along an `axis` of the surface point above the reference place (x, y) mm."""
    return f"u{axis}({place[0]:g},{place[1]:g})"


def plain_settings(settings: Settings) -> dict[str, Any]:
    """What of the settings can change an answer, as plain data with all defaults written out."""
    return {
        "specimen": settings.specimen.plain(),
        "indenter": settings.indenter.plain(),
        "support": settings.support.plain(),
        "material": law_table(settings.law, settings.terms, settings.prony),
        "point": list(settings.point),
        "direction": settings.direction,
        "profile": [list(p) for p in settings.profile],
        "earlier": settings.earlier,
        "mesh": dict(settings.mesh),
        **_drainage(settings),
        **({} if settings.multipliers else {"multipliers": False}),
    }


def _drainage(settings: Settings) -> dict[str, Any]:
    """The table of how liquid flows; none where all of it is as usual."""
    out: dict[str, Any] = {}
    if settings.drainage != (SEALED, SEALED):
        out |= dict(zip(("indenter", "support"), settings.drainage, strict=True))
    if not settings.closes.constant:
        out["holmes_mow"] = dataclasses.asdict(settings.closes)
    return {"drainage": out} if out else {}


def _distinct(places: Sequence[tuple[float, float]]) -> list[str]:
    """Each mark has a channel of its own."""
    names, wrong = [profile_name(p) for p in places], []
    for k, ((x, y), name) in enumerate(zip(places, names, strict=True)):
        if name in names[:k]:
            wrong.append(
                f"profile: the marks {list(places[names.index(name)])} and [{x!r}, {y!r}] mm would share the "
                f"channel {name}; marks differ in their first six digits"
            )
    return wrong


def choices() -> dict[str, Any]:
    """The settings as JSON schemas, for `--schema`: those of every member by its name, then the common ones."""
    members_of = {
        noun: {name: member.Table.model_json_schema() for name, member in s.members.items()} for noun, s in SETS.items()
    }
    return {**members_of, "experiment": SettingsTable.model_json_schema()}
