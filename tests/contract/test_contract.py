"""What every backend must keep: one suite, run for each line of SUBJECTS.

To add a backend, add one :class:`Subject`.  Backends that need artefacts get them made once for the whole suite.
"""

import dataclasses
import json
import math
import os
import pickle
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from fem_backend.indenters import INDENTERS
from fem_backend.specimens import SPECIMENS, own_laws
from fem_backend.specimens.specimen import LAYER_KNOBS, PLACE_KNOBS
from fem_backend.supports import SUPPORTS
from rso.contract import CAUSES, Case, Programme, Response, Scope, SimulationFailed, digest, run_key
from rso.evaluation import Source
from rso.evaluation.store import RunStore

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Subject:
    """A backend and a sensible small case of it.

    `values` holds every parameter without default.  `other_setting` is a change of the settings that changes the
    answer, `unknown_setting` one that no backend knows, `failing` (values, settings, asked_mm) a run that must end in
    SimulationFailed.  `inert` are parameters that have no influence in this case: no key depends on them.
    """

    source: Source
    values: dict[str, float]
    settings: dict[str, Any]
    other_setting: dict[str, Any]
    failing: tuple[dict[str, float], dict[str, Any], tuple[float, ...]] | None = None
    asked_mm: tuple[float, ...] = (0.5, 1.0)
    inert: frozenset[str] = frozenset()
    checks_settings: bool = True


HERTZ = {
    "values": {"mu": 0.01, "D1": 5.8},
    "settings": {"radius": 3.0},
    "other_setting": {"radius": 2.0},
    "failing": ({"mu": 0.01, "D1": 5.8}, {"radius": 0.9}, (0.5, 1.0)),
}
SLAB = {"specimen": {"shape": "slab", "thickness": 6.0}, "support": {"kind": "bonded"}, "mesh": {"level": "coarse"}}
MAPPED = {"mesher": "mapped", "n": 6, "slip": 0.3}  # the same to the bit everywhere, and coarse
SUBJECTS = {
    "hertz": Subject(Source(use="hertz_backend:BACKEND", base=str(HERE)), **HERTZ),
    "hertz command": Subject(
        Source(command=(sys.executable, "hertz_command.py"), base=str(HERE)), checks_settings=False, **HERTZ
    ),
    "finite elements": Subject(
        Source(use="fem_backend.backend:BACKEND"),
        values={"mu": 0.01, "D1": 5.8},
        settings={"mesh": MAPPED},
        other_setting={"indenter": {"shape": "sphere", "radius": 2.0}},
        # deeper than small strains can follow, with what was reached
        failing=({"mu": 0.01, "D1": 5.8}, {"mesh": MAPPED, "material": {"law": "linear_elastic"}}, (0.5, 6.0)),
        inert=SPECIMENS.of_others("ellipsoid")
        | INDENTERS.of_others("sphere")
        | SUPPORTS.of_others("fixed")
        | {*LAYER_KNOBS}
        | own_laws.everything(),
    ),
    "finite elements of a slab": Subject(
        Source(use="fem_backend.backend:BACKEND"),
        values={"mu": 0.01, "D1": 5.8},
        settings=SLAB,
        other_setting={"indenter": {"shape": "sphere", "radius": 2.0}},
        failing=({"mu": 0.01, "D1": 1e-6}, SLAB, (0.5, 1.0)),  # K/mu = 2e8
        inert=SPECIMENS.of_others("slab")
        | INDENTERS.of_others("sphere")
        | SUPPORTS.of_others("bonded")
        | {*PLACE_KNOBS, *LAYER_KNOBS}
        | own_laws.everything(),
    ),
}


@dataclass(frozen=True)
class Prepared:
    """A subject with its backend loaded, its canonical task and one response, computed once."""

    subject: Subject
    backend: Any
    values: dict[str, float]
    case: Case
    response: Response

    def key(self, values=None, case=None):
        """Key of a task as `run_all` would compute it (artefacts aside)."""
        return run_key(self.backend, *self.backend.canonical(values or self.subject.values, case or self.case))


@pytest.fixture(scope="module", params=SUBJECTS)
def it(request, tmp_path_factory):
    subject = SUBJECTS[request.param]
    backend = subject.source.load()
    case = Case("case", Programme.ramp(subject.asked_mm), subject.settings)
    values, case = backend.canonical(subject.values, case)
    with RunStore(tmp_path_factory.mktemp("artefacts")) as store:
        recipes = backend.recipes(values, case)
        shas = {name: store.put_artefact(name, recipe, backend.make(recipe)) for name, recipe in recipes.items()}
    if shas:
        case = dataclasses.replace(case, artefacts=shas, objects=str(store.objects))
    return Prepared(subject, backend, values, case, backend(values, case))


def result(response: Response) -> dict[str, Any]:
    """What a result consists of: everything but the facts about the run."""
    return {k: v for k, v in response.to_json().items() if k != "info"}


def inside(p):
    """A value strictly between the bounds, away from neutral and default; the typical one if there is one."""
    if p.typical is not None and p.low < p.typical < p.high and p.typical != p.neutral:
        return p.typical
    middle = math.sqrt(p.low * p.high) if p.low > 0 else 0.5 * (p.low + p.high)
    return middle if middle not in (p.neutral, p.default) else 0.5 * (middle + p.high)


# ---------------------------------------------------------------------------------------------- declarations


def test_parameters_have_units_and_consistent_bounds(it):
    names = [p.name for p in it.backend.parameters]
    assert len(set(names)) == len(names) > 0
    for p in it.backend.parameters:
        assert p.name.isidentifier() and p.description and p.unit, p
        assert math.isfinite(p.low) and math.isfinite(p.high) and p.low < p.high, p
        for start in (p.default, p.neutral, p.typical):
            assert start is None or p.check(start) == start
        assert p.neutral is None or p.default == p.neutral, f"{p.name}: an effect is off unless asked for"
        assert p.scope in get_args(Scope)


def test_identity_and_channels(it):
    assert isinstance(it.backend.name, str) and it.backend.name
    assert isinstance(it.backend.numerics, int)
    assert it.backend.channels["time"] == "s" and it.backend.channels["travel"] == "mm"


def test_values_of_the_suite_are_sensible(it):
    """The suite itself: a typo in SUBJECTS must not make a test pass for the wrong reason."""
    names = {p.name for p in it.backend.parameters}
    assert set(it.subject.values) <= names and it.subject.inert <= names
    it.backend.check(it.case)


# ---------------------------------------------------------------------------------------------- misuse


def test_unknown_setting_is_refused(it):
    case = dataclasses.replace(it.case, settings={**it.case.settings, "no_such_setting": 1})
    if it.subject.checks_settings:
        with pytest.raises(ValueError, match="no_such_setting"):
            it.backend.check(case)
    else:
        with pytest.raises(RuntimeError, match="no_such_setting"):
            it.backend(it.values, case)


def test_values_out_of_bounds_are_refused(it):
    for p in it.backend.parameters:
        for bad in (np.nextafter(p.low, -np.inf), np.nextafter(p.high, np.inf), math.nan, math.inf):
            values = {**it.subject.values, p.name: float(bad)}
            with pytest.raises(ValueError, match=p.name):
                it.backend(*it.backend.canonical(values, it.case))
            with pytest.raises(ValueError, match=p.name):
                it.backend(values, it.case)


def test_unknown_and_missing_values_are_refused(it):
    with pytest.raises(ValueError, match="no_such_knob"):
        it.backend({**it.subject.values, "no_such_knob": 1.0}, it.case)
    for p in it.backend.parameters:
        if p.default is None:
            with pytest.raises(ValueError, match=p.name):
                it.backend({k: v for k, v in it.subject.values.items() if k != p.name}, it.case)


# ---------------------------------------------------------------------------------------------- responses


def test_response_has_declared_channels_and_finite_numbers(it):
    r = it.response
    assert {"time", "travel"} <= set(r.channels) <= set(it.backend.channels)
    assert all(r.units[c] == it.backend.channels[c] for c in r.channels)
    for numbers in (*r.channels.values(), *r.error.values()):
        assert np.all(np.isfinite(numbers))
    assert set(r.error) <= set(r.channels) and all(np.all(e >= 0) for e in r.error.values())


def test_response_is_at_the_asked_depths(it):
    a = np.array(it.subject.asked_mm)
    # asked and returned depth are the same decimal number; the time comes from one interpolation
    np.testing.assert_allclose(it.response.channels["travel"], a, rtol=1e-12)
    t, u = it.case.programme.time_s, it.case.programme.travel_mm
    np.testing.assert_allclose(it.response.channels["time"], np.interp(a, u, t), rtol=1e-12)


def test_same_inputs_same_bits(it):
    assert result(it.backend(it.values, it.case)) == result(it.response)
    assert digest(result(it.response)) != digest({**result(it.response), "units": {}})  # negative control


def test_defaults_given_or_left_out_same_bits(it):
    """Values as a person writes them and in canonical form give the same answer."""
    full = {p.name: p.default for p in it.backend.parameters if p.default is not None} | it.subject.values
    assert result(it.backend(full, it.case)) == result(it.response)


FRESH = """
import json, sys
from rso.contract import Case, digest
from rso.evaluation import Source
source, values, case = json.loads(sys.stdin.read())
source["command"], source["others"] = tuple(source["command"]) if source["command"] else None, ()
r = Source(**source).load()(values, Case.from_json(case)).to_json()
print(digest({k: v for k, v in r.items() if k != "info"}))
"""


def test_same_bits_in_a_fresh_process(it):
    request = json.dumps([dataclasses.asdict(it.subject.source), it.values, it.case.to_json()])
    env = {**os.environ, "PYTHONHASHSEED": "12345"}  # sets of strings in another order
    done = subprocess.run([sys.executable, "-c", FRESH], input=request, capture_output=True, text=True, env=env)
    assert done.stdout.strip() == digest(result(it.response)), done.stderr


def test_json_round_trip_is_exact(it):
    back = Response.from_json(json.loads(json.dumps(it.response.to_json())))
    for part in ("channels", "error"):
        a, b = getattr(it.response, part), getattr(back, part)
        assert {k: v.tobytes() for k, v in a.items()} == {k: v.tobytes() for k, v in b.items()}
    assert back.units == dict(it.response.units)
    assert Case.from_json(json.loads(json.dumps(it.case.to_json()))).to_json() == it.case.to_json()


def test_failure_is_picklable(it):
    if it.subject.failing is None:
        pytest.skip("no failing case given")
    values, settings, asked = it.subject.failing
    with pytest.raises(SimulationFailed) as failure:
        it.backend(*it.backend.canonical(values, Case("failing", Programme.ramp(asked), settings)))
    # libraries such as tblib (Dask) pickle these too, with all that they hold
    assert failure.value.__cause__ is None and failure.value.__context__ is None
    back = pickle.loads(pickle.dumps(failure.value))
    assert back.cause in CAUSES and back.reason
    assert (str(back), back.cause, back.reason) == (str(failure.value), failure.value.cause, failure.value.reason)


def test_backend_and_response_are_picklable(it):
    backend = pickle.loads(pickle.dumps(it.backend))
    assert run_key(backend, it.values, it.case) == run_key(it.backend, it.values, it.case)
    assert result(pickle.loads(pickle.dumps(it.response))) == result(it.response)


# ---------------------------------------------------------------------------------------------- keys


def test_canonical_is_idempotent(it):
    values, case = it.backend.canonical(it.values, it.case)
    assert values == it.values and case.to_json() == it.case.to_json()


def test_recipes_are_those_of_the_canonical_task(it):
    again = it.backend.canonical(it.subject.values, dataclasses.replace(it.case, name="other"))
    assert dict(it.backend.recipes(*again)) == dict(it.backend.recipes(it.values, it.case))


def test_key_ignores_names_and_the_writing_of_numbers(it):
    key = it.key()
    assert key == it.key(case=dataclasses.replace(it.case, name="other"))
    assert key == it.key(case=dataclasses.replace(it.case, objects="/elsewhere"))
    assert key == it.key({k: np.float64(v) for k, v in it.subject.values.items()})
    assert key == it.key(dict(reversed(it.subject.values.items())))
    whole = {p.name: round(inside(p)) for p in it.backend.parameters if p.name in it.subject.values}
    whole = {p.name: whole[p.name] for p in it.backend.parameters if p.low <= whole.get(p.name, -math.inf) <= p.high}
    ints, floats = it.subject.values | whole, it.subject.values | {k: float(v) for k, v in whole.items()}
    assert it.key(ints) == it.key(floats)


def test_key_ignores_effects_at_neutral(it):
    neutral = {p.name: p.neutral for p in it.backend.parameters if p.neutral is not None}
    assert it.key() == it.key(neutral | it.subject.values)
    values, _ = it.backend.canonical(neutral | it.subject.values, it.case)
    assert not [k for k in neutral if values.get(k) == neutral[k]], "a later effect must not change today's keys"


def test_key_sees_the_last_bit_of_every_value(it):
    for p in it.backend.parameters:
        if p.name not in it.values or p.name in it.subject.inert:
            continue
        value = it.values[p.name]
        toward = p.high if value < p.high else p.low
        assert it.key() != it.key({**it.subject.values, p.name: float(np.nextafter(value, toward))}), p.name


def test_key_sees_every_effect(it):
    """An effect is switched on with its group (a Prony g without its tau is nothing)."""
    for p in it.backend.parameters:
        if p.neutral is None or p.name in it.subject.inert:
            continue
        group = {q.name: inside(q) for q in it.backend.parameters if q.group and q.group == p.group}
        on = {**it.subject.values, **group, p.name: inside(p)}
        assert it.key() != it.key(on), p.name
        assert it.key(on) != it.key({**on, p.name: float(np.nextafter(on[p.name], p.high))}), p.name


def test_key_sees_settings_programme_and_artefacts(it):
    cases = [
        it.case,
        dataclasses.replace(it.case, settings={**it.case.settings, **it.subject.other_setting}),
        dataclasses.replace(
            it.case, programme=Programme.ramp((*it.subject.asked_mm[:-1], it.subject.asked_mm[-1] * 1.1))
        ),
    ]
    keys = {it.key(case=case) for case in cases}
    keys.add(run_key(it.backend, it.values, dataclasses.replace(it.case, artefacts={"mesh": "0" * 64})))
    assert len(keys) == 4


# ---------------------------------------------------------------------------------------------- the example itself


def test_hertz_against_its_incompressible_limit():
    """F = 16/3 mu sqrt(R) d^(3/2) for nu = 1/2, on the way down and on the way back."""
    programme = Programme((0.0, 4.0, 8.0), (0.0, 1.0, 0.0), (0.25, 1.0))
    backend = SUBJECTS["hertz"].source.load()
    r = backend({"mu": 0.01, "D1": 1e-3}, Case("c", programme, {"radius": 3.0}))
    np.testing.assert_array_equal(r.channels["time"], [1.0, 4.0, 7.0])
    d = np.array([0.25, 1.0, 0.25])
    # mu/K = 5e-6 changes E* by about that much
    np.testing.assert_allclose(r.channels["Fz"], 16 / 3 * 0.01 * np.sqrt(3.0) * d**1.5, rtol=2e-5)
