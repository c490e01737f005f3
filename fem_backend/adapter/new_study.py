"""A first study: settings by the options of `rso new`, ranges by the limits of Hertz and JKR."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fem_backend.laws import LAWS
from fem_backend.members import SettingsOption
from fem_backend.simulation.experiment import SETS
from fem_backend.supports import SUPPORTS
from rso.contract import Given, Line, Option

MAX_MESH_ERROR_SHARE = 0.035  # of the force at the deepest reading: what the mesh of a new study may miss
MODULUS_RANGE_FACTOR = 3.0  # of the modulus of Hertz's limit, whose half-space the body is not
MIN_PULL_READINGS = 4  # readings that show a pull beside a tare
MIN_PULL_SHARE = 0.1  # of its range: a force that is negative by more pulls
UNTOLD_MODULUS_RANGE_MPA = (0.001, 1.0)  # MPa, of a modulus that no force curve tells
MU_D1_AT_MIDDLE_AND_END = (0.01, 1.8)  # mu D1, at the middle of the range of mu and at its end: ν = 0.4975 and 0.15
WALLED_FORCE_RATIO = 3.0  # a well as wide as the indenter makes 1.6 to 4.5 times the force of a slab without a wall
HERTZ_LIMIT = "Hertz's limit"
UNIFORM_LIMIT = "uniform compression"
Limit = Callable[[np.ndarray, np.ndarray], Mapping[str, float]]  # of depths (n,) mm and Fz (n,) N, by knob


def options() -> tuple[SettingsOption, ...]:
    """Options of all members, those of specimens first."""
    return tuple(dict.fromkeys(o for kind in SETS.values() for o in kind.options()))


def geometry(given: Given, depths: Sequence[float] = ()) -> dict[str, Line]:
    """Specimen, indenter, support and law by options; ValueError for what is missing or contradicts.

    `depths` (mm) of records show lengths that were left out.
    """
    known = {o.name: o for o in options()}
    tables: dict[str, dict[str, Any]] = {}
    said: dict[str, list[str]] = {}
    chosen: dict[str, list[str]] = {}
    guesses: dict[str, str] = {}
    for name, values in given.items():
        words = option_text(known[name], values)
        for noun, table in _tables(known[name], known[name].completed(values, depths)).items():
            tables[noun] = {**tables.get(noun, {}), **table}
            said.setdefault(noun, []).append(words)
            if SETS[noun].tag in table:
                chosen.setdefault(noun, []).append(words)
                left_out = len(values) < len(known[name].words) or not known[name].least
                guesses[noun] = known[name].guess if left_out else ""
    for noun, each in chosen.items():
        if len(each) > 1:
            raise ValueError(f"{' and '.join(each)}: {len(each)} {noun}s are given, one is expected")
    for noun in ("specimen", "indenter"):
        if noun not in chosen:
            each = [" ".join([f"--{o.name}", *o.words]) for o in SETS[noun].options() if not o.adds]
            raise ValueError(f"no {noun} is given: one of {', '.join(each)} is expected; lengths are in mm")
    members = {noun: _read(noun, table, said[noun]) for noun, table in tables.items()}
    lines = {noun: Line(table, guesses.get(noun, ""), bool(guesses.get(noun))) for noun, table in tables.items()}
    if "support" in members and (why := members["support"].refusal(members["specimen"])):
        raise ValueError(f"{' '.join([*said['specimen'], *said['support']])}: {why}")
    if "support" not in lines:
        usual = {SUPPORTS.tag: members["specimen"].rests}
        lines["support"] = Line(usual, _other_supports(members["specimen"]), True)
    laws = [name for name in LAWS.members if name != LAWS.default]
    lines[LAWS.noun] = Line({LAWS.tag: LAWS.default}, f"or {', '.join(laws)}", True)
    return {noun: lines[noun] for noun in SETS}


def option_text(option: Option, values: Sequence[float | str]) -> str:
    """An option as it was given: --slab 2.3 mm."""
    units = [*option.units, *option.units[-1:] * len(values)]
    each = [f"{v:g} {u}" if isinstance(v, float) else str(v) for v, u in zip(values, units, strict=False)]
    return " ".join([f"--{option.name}", *each])


def _tables(option: SettingsOption, values: Sequence[float | str]) -> Mapping[str, Mapping[str, Any]]:
    """The tables that an option means; ValueError naming it."""
    try:
        return option.settings(*values)
    except ValueError as error:
        raise ValueError(f"{option_text(option, values)}: {error}") from error


def _read(noun: str, table: Mapping[str, Any], said: Sequence[str]) -> Any:
    """The member of a table; ValueError naming its options."""
    try:
        return SETS[noun].read(table)
    except ValueError as error:
        raise ValueError(f"{' '.join(said)}: {error}") from error


def _other_supports(specimen: Any) -> str:
    """What the usual support of a specimen does, and how others that carry it are written."""
    usual, words = SUPPORTS.members[specimen.rests], []
    for member in SUPPORTS.members.values():
        try:
            carries = member is not usual and member.Table().build().refusal(specimen) is None
        except ValueError:  # it has no sizes of its own
            continue
        words += [member.Table.__doc__] if carries else []
    does = usual.Table.model_fields[SUPPORTS.tag].description
    return "; or ".join([does[:1].lower() + does[1:].rstrip("."), *words])


def mesh(depths: Sequence[float], errors_at: Callable[[float], Mapping[str, float]]) -> Line:
    """The cheapest level that resolves the shallowest of tests to `depths` (mm), and what it misses of the force there.

    `errors_at` says of a depth (mm) the share that each level misses, from cheap to costly.
    """
    d = min(depths, default=0.0)
    if d <= 0.0:
        return Line({"level": "coarse"}, "standard, fine and reference cost more")
    errors = errors_at(d)
    level = next(
        (name for name, error in errors.items() if error <= MAX_MESH_ERROR_SHARE), min(errors, key=errors.__getitem__)
    )
    others = ", ".join(f"{n} {100 * v:.2g} %" for n, v in errors.items() if n != level)
    said = f"about {100 * errors[level]:.2g} % in force at {_two(d)} mm, more where it is shallower; {others}"
    return Line({"level": level}, said)


def suggested_ranges(
    depth: np.ndarray, force: np.ndarray, hertz: Limit, jkr: Limit, name: str = HERTZ_LIMIT, walled: bool = False
) -> dict[str, Line]:
    """Ranges about the modulus that a loading Fz (n,) N at depths (n,) mm has in a limit; wide ones if n = 0.

    The limit is Hertz's or another closed form by `name`, of a body without the wall of one that is `walled`: with it
    the modulus may be far less.  The shallow half counts.  Where the force pulls, the JKR
    limit says modulus and adhesion.  A limit that knows no modulus (an empty one) leaves wide ranges.  ValueError for a
    record whose modulus would not be positive.
    """
    mu: float = 0.0
    pull: Mapping[str, float] = {}
    part = "the shallow half"
    if len(depth):
        shallow = (depth > 0.0) & (depth <= 0.5 * float(depth.max()))
        if not shallow.any():
            shallow, part = depth > 0.0, "all readings"
        found = hertz(depth[shallow], force[shallow]) if shallow.any() else {"mu": 0.0}
        mu = float(found.get("mu", 0.0))
        if _adheres(force):
            pull = jkr(depth, force)
            mu = float(pull.get("mu", mu))
        if mu <= 0.0 and (found or pull):
            raise ValueError(
                f"the modulus by {name} would be {mu:.2g} MPa, which is not possible. Fz falls while the indenter "
                "goes deeper: is this a tensile record, or is a sign or a zero wrong?"
            )
    low, high = (
        (mu / (WALLED_FORCE_RATIO if walled else 1.0) / MODULUS_RANGE_FACTOR, mu * MODULUS_RANGE_FACTOR)
        if mu > 0
        else UNTOLD_MODULUS_RANGE_MPA
    )
    limit = f"{name} of {part} says about {_two(1e3 * mu)} kPa"
    limit = f"adhesion: the JKR limit says about {_two(1e3 * mu)} kPa" if pull else limit
    limit += "; the wall of the well makes that too much, no formula has one" if walled else ""
    why = limit if mu > 0 else "the readings do not show it: narrow it"
    bulk = "bulk modulus K = 2 / D1; Poisson ratio 0.15 where both are high"
    return {
        "mu": _range(1e3 * low, 1e3 * high, "kPa", why),
        "D1": _range(
            MU_D1_AT_MIDDLE_AND_END[0] / math.sqrt(low * high), MU_D1_AT_MIDDLE_AND_END[1] / high, "1/MPa", bulk
        ),
        **_adhesion(pull),
    }


def _adhesion(pull: Mapping[str, float]) -> dict[str, Line]:
    """The range of an adhesion that the record shows."""
    if not pull:
        return {}
    w = float(pull["adhesion"])
    said = f"Fz pulls: adhesion; JKR says about {_two(w)} N/mm, contact at {pull['contact']:.3g} mm in the file"
    found = {"adhesion": _range(w / MODULUS_RANGE_FACTOR, w * MODULUS_RANGE_FACTOR, "N/mm", said)}
    if "adhesion_range" not in pull:
        return found
    reach = f"{_two(pull['adhesion_range'])} mm"
    short = "shorter costs more and stops to matter at some length; compare rso run at two of them"
    return {**found, "adhesion_range": Line({"value": reach}, short, True)}


def _adheres(force: np.ndarray) -> bool:
    """Whether a loading curve (n,) is pulled by more than a tare or its scatter may be."""
    if len(force) < MIN_PULL_READINGS:
        return False
    noise = 1.5 * float(np.median(np.abs(np.diff(force, 2)))) / 6**0.5
    return float(force.min()) < -max(MIN_PULL_SHARE * float(np.ptp(force)), 10.0 * noise) and int(np.argmin(force)) > 0


def _range(low: float, high: float, unit: str, said: str) -> Line:
    return Line({"low": f"{_two(low)} {unit}", "high": f"{_two(high)} {unit}", "scale": "log"}, said, True)


def _two(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"
