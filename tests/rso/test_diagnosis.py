"""A diagnosis from end to end on a body in closed form: what is planted is found, what is not planted is not."""

import dataclasses
import functools
import json

import diagnosis_backend as toy
import numpy as np
import pytest
from scipy.special import logsumexp

from rso import discrepancy
from rso.contract import plain
from rso.data import Noise
from rso.discrepancy import Diagnosis, Library, build_library, diagnosis_data, make_test_plan
from rso.discrepancy.diagnosis import _opened
from rso.discrepancy.evidence import attribution, marginal_ranges
from rso.discrepancy.evidence.attribution import Evidence, set_up
from rso.discrepancy.evidence.cross_validation import _chosen_without, left_out_gaps
from rso.discrepancy.evidence.gaussian_mixture import mixture_log_evidence, posterior, posterior_each
from rso.discrepancy.evidence.hypotheses import Hypothesis
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS, DiagnosisSettings
from rso.discrepancy.wording import _named, _otherwise, _single

NAMES = ("stiff", "skin", "soften", "offset", "bias")
NULLS = 100
BASE = toy.base(axes=False)
TRUTH = {"mu": 0.012, "D1": 60.0 * BASE.reference / 0.012}  # κ as the base model has it


def experiments(seed: int, truth=None, validate: bool = False, each_offset: float = 0.0, **chain: float):
    """Repeats, a cycle, a deep curve: little, so that a diagnosis takes about a second."""
    rng, body = np.random.default_rng(seed), {**TRUTH, **(truth or {})}
    deep = toy.recorded(body, rng, peak=6.0, earlier=4.0, each_offset=each_offset, **chain)
    cycle = toy.recorded(body, rng, unload=True, earlier=4.0, each_offset=each_offset, **chain)
    return [
        toy.experiment("load", toy.recorded(body, rng, repeats=3, each_offset=each_offset, **chain)),
        toy.experiment("cycle", cycle, after=("load",)),
        toy.experiment("deep", deep, role="validate" if validate else "fit", after=("cycle",)),
    ]


@functools.cache
def tables(names: tuple[str, ...], validate: bool) -> Library:
    return build_library(BASE, make_test_plan(experiments(0, validate=validate)), toy.effects(*names), toy.run)


def with_priors(**changed) -> DiagnosisSettings:
    return dataclasses.replace(DIAGNOSIS_SETTINGS, priors=dataclasses.replace(DIAGNOSIS_SETTINGS.priors, **changed))


def diagnose(seed: int, truth=None, names=NAMES, validate: bool = False, **chain: float) -> Diagnosis:
    """One library serves all data of the same plan."""
    plan = make_test_plan(experiments(seed, truth, validate, **chain))
    return discrepancy.diagnose(dataclasses.replace(tables(names, validate), plan=plan), seed, nulls=NULLS)


def cause(d: Diagnosis, name: str):
    return next(c for c in d.causes if c.effect.name == name)


def test_nothing_planted_is_no_gap():
    """At a level of 5 % more than four of twenty null data sets raise an alarm in 0.3 % of cases."""
    found = [diagnose(seed, names=("stiff", "skin", "soften")) for seed in range(100, 120)]
    alarms = [d for d in found if d.verdict != "no_gap"]
    assert len(alarms) <= 4
    assert all(d.p_value <= DIAGNOSIS_SETTINGS.rules.false_alarm for d in alarms)
    assert all(not d.causes for d in found if d.verdict == "no_gap")
    assert 0.7 < np.mean([d.size_over_noise for d in found]) < 1.2


@pytest.mark.parametrize(
    "name, value, chain",
    [("soften", 0.2, False), ("skin", 2.5, False), ("offset", 0.15, True), ("bias", 0.02, True)],
)
def test_what_is_planted_is_named_with_its_size(name, value, chain):
    found = []
    for seed in range(3):
        planted = {name: value}
        found.append(diagnose(seed, None if chain else planted, **(planted if chain else {})))
    assert all(d.p_value <= DIAGNOSIS_SETTINGS.rules.false_alarm for d in found)
    named = [d for d in found if name in d.named]
    assert len(named) == 3
    alone = [d for d in found if d.verdict == ("measurement" if chain else "explained")]
    assert len(alone) >= 2
    sizes = [cause(d, name) for d in named]
    # a 90 % interval misses two of three in 3 % of cases
    assert sum(c.interval[0] <= value <= c.interval[1] for c in sizes) >= 2, [(c.size, c.interval) for c in sizes]


def test_a_size_of_the_chain_is_that_at_the_modulus_which_goes_with_it():
    """A bias is found beside a modulus that moves: its interval covers the bias in newtons."""
    d = diagnose(5, bias=-0.03)
    c = cause(d, "bias")
    assert c.interval[0] <= -0.03 <= c.interval[1]
    before, after = d.parameters["before"]["mu"], d.parameters["after"]["mu"]
    assert abs(after[1] - TRUTH["mu"]) < abs(before[1] - TRUTH["mu"])


@pytest.mark.parametrize("away", [-4.0, 3.0])
def test_a_test_done_at_another_place_than_noted_is_the_measurement(away):
    """Not the body; and a misalignment of every test is found as one of every test, beside the tilt it looks like."""

    def found(shift: float, everywhere: bool) -> tuple[Library, Diagnosis]:
        made, rng = experiments(4, {"shift": shift} if everywhere else None), np.random.default_rng(11)
        truth = {**TRUTH, "shift": shift}
        made.append(
            toy.experiment(
                "side", toy.recorded(truth, rng, point=(10.0, 0.0), lateral=True, repeats=2), point=(10.0, 0.0)
            )
        )
        plan = make_test_plan(made)
        effects = discrepancy.localised(toy.effects(*NAMES, "shift", "tilt"), plan.labels())
        library = build_library(BASE, plan, effects, toy.run)
        return library, discrepancy.diagnose(library, 4, nulls=NULLS)

    library, d = found(away, False)
    assert d.verdict == "measurement" and d.named == ("shift at (10, 0)",), (d.verdict, d.named)
    c = cause(d, "shift at (10, 0)")
    assert c.interval[0] <= away <= c.interval[1]
    assert set(found(1.2, True)[1].named) == {"tilt", "shift"}
    said = diagnosis_data(library, d, (), None, "")["words"]
    assert any("it is the measurement" in w.lower() for w in said) and any("no other can confirm" in w for w in said)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_lateral_force_of_the_wrong_sign_is_told_before_any_cause(sign):
    """Everyday: a channel whose sign is the machine's.  With the right one nothing is said."""
    rng = np.random.default_rng(4)
    side = toy.recorded(TRUTH, rng, point=(10.0, 0.0), lateral=True, repeats=2)
    side = tuple(dataclasses.replace(r, channels={**r.channels, "Fx": sign * r.channels["Fx"]}) for r in side)
    plan = make_test_plan([*experiments(4), toy.experiment("side", side, point=(10.0, 0.0))])
    library = build_library(BASE, plan, toy.effects("gain"), toy.run)
    found = diagnosis_data(library, discrepancy.diagnose(library, 0, NULLS), (), None, "")
    assert [(r["experiment"], r["channel"]) for r in found["mirrored"]] == ([("side", "Fx")] if sign < 0 else [])
    assert any("Opposite to the model in sign: Fx in side" in w for w in found["words"][:2]) == (sign < 0)


def test_forms_share_the_prior_of_their_cause_and_one_place_teaches_nothing_of_another():
    made, rng = experiments(4), np.random.default_rng(11)
    side = toy.recorded(TRUTH, rng, point=(10.0, 0.0), lateral=True, repeats=2)
    plan = make_test_plan([*made, toy.experiment("side", side, point=(10.0, 0.0))])
    library = build_library(BASE, plan, discrepancy.localised(toy.effects("stiff", "shift"), plan.labels()), toy.run)
    y = plan.values()
    evidence = attribution.Evidence(attribution.set_up(library, y), library.effects)
    pair = tuple(e for e in library.effects if e.name in ("stiff", "shift"))
    (contest,) = attribution.comparisons(evidence, y[None], [pair])
    P = {}
    for h, p in zip(contest.hypotheses, np.exp(contest.log_prior), strict=True):
        key = (*sorted(e.source for e in h.effects), h.unexplained)
        P[key] = P.get(key, 0.0) + float(p)
    for more in (False, True):
        each = [P[s, more] for s in ("stiff", "shift", "shift at one place")]
        np.testing.assert_allclose(each, each[0], rtol=1e-12)
    # of 3 pairs
    np.testing.assert_allclose(P["shift", "stiff", False], 0.5 * DIAGNOSIS_SETTINGS.priors.pair / 3, rtol=1e-12)
    beside = np.concatenate([np.arange(at.start, at.stop) for t, _, at in plan.rows() if t.place == 1])
    rest = np.setdiff1d(np.arange(plan.n), beside)
    away = next(e for e in library.effects if e.name == "shift at (10, 0)")
    moved = y + 0.05 * np.isin(np.arange(plan.n), beside) * np.max(y)  # nothing but the tests there say so
    assert _chosen_without(evidence, rest, moved, Hypothesis((away,))) == ()
    known = left_out_gaps(library, evidence.bench, evidence, moved, Hypothesis((away,)), 0, anew=False)
    causes = {c.curve: c.cause for c in known.curves}
    assert causes["side"] == () and causes["load"] == ("shift at (10, 0)",)  # not a size of the prior alone


def test_a_cause_that_is_not_in_the_catalogue_is_not_made_up():
    """Softening shows on the way back, where nothing else in this catalogue acts."""
    found = [diagnose(seed, {"soften": 0.35}, names=("stiff", "skin", "bias")) for seed in range(3)]
    assert all(d.verdict in ("unexplained", "partly") for d in found), [d.verdict for d in found]


def clipped(name: str, found: list) -> list:
    """The experiments with one file from a cell that gives less above 3 mm."""
    out = []
    for e in found:
        repeats = e.measurement.repeats
        if e.name == name:
            share = [np.minimum(1.0, 3.0 / np.maximum(r.depth, 1e-9)) for r in repeats]
            repeats = tuple(
                dataclasses.replace(r, channels={**r.channels, "Fz": k * r.channels["Fz"]})
                for r, k in zip(repeats, share, strict=True)
            )
        out.append(dataclasses.replace(e, measurement=dataclasses.replace(e.measurement, repeats=repeats)))
    return out


@pytest.mark.parametrize("name", ["load", "cycle", "deep"])
def test_one_experiment_that_is_odd_is_told(name):
    """One of three at the same point has a clipped file: no cause that all share, and the answer says which."""
    plan = make_test_plan(clipped(name, experiments(3)))
    d = discrepancy.diagnose(dataclasses.replace(tables(NAMES, False), plan=plan), 3, nulls=NULLS)
    assert d.verdict == "unexplained" and not d.causes
    assert max(d.probabilities, key=d.probabilities.get) == "none + unexplained"
    assert d.remainder is None and d.odd is not None and d.odd[0] == name
    clear = [g for g in d.where.regions if abs(g.z) > d.where.threshold]
    off = {when: abs(v["mu"][1] / TRUTH["mu"] - 1.0) for when, v in d.parameters.items()}
    assert off["after"] < off["before"]  # nor in the modulus
    assert clear and all(g.experiment == name and g.z < 0 for g in clear)  # it has no say in what the others should be


def test_what_all_experiments_have_is_in_none_alone():
    plan = make_test_plan([screwed(e, 0.025, 1.3) for e in experiments(3)])
    d = discrepancy.diagnose(dataclasses.replace(tables(NAMES, False), plan=plan), 3, nulls=NULLS)
    assert d.verdict == "unexplained" and d.odd is None


@pytest.mark.parametrize("name", ["load", "cycle", "deep"])
def test_a_part_that_only_widens_the_gap_of_other_curves_is_none(name):
    """Softening or stiffening makes most of a file that is clipped, and nothing of the other files."""
    plan = make_test_plan(clipped(name, experiments(3)))
    library = dataclasses.replace(tables(NAMES, False), plan=plan)
    d = discrepancy.diagnose(library, 3, nulls=NULLS, settings=with_priors(alone=()))
    assert d.verdict == "unexplained" and not d.causes
    likely = max(d.probabilities, key=d.probabilities.get)
    assert likely.startswith(("soften", "stiff"))  # evidence alone would name it


def test_a_body_that_stiffens_from_test_to_test_is_found_and_is_no_scatter_of_gains():
    """Warmth or drying, 20 % over five tests whose gains scatter by 1 %."""
    made = []
    for e, k in zip(experiments(6), ((0, 1, 2), (3,), (4,)), strict=True):
        factor = [1.0 + 0.2 * (i / 4 - 0.5) for i in k]
        repeats = tuple(
            dataclasses.replace(r, channels={"Fz": f * r.channels["Fz"]})
            for r, f in zip(e.measurement.repeats, factor, strict=True)
        )
        made.append(dataclasses.replace(e, measurement=dataclasses.replace(e.measurement, repeats=repeats)))
    plan = make_test_plan(made)
    assert [t.age for t in plan.tests] == [-0.5, -0.25, 0.0, 0.25, 0.5]
    library = build_library(BASE, plan, toy.effects("stiff", "soften", "gain", "gain_each", "ageing"), toy.run)
    d = discrepancy.diagnose(library, 6, nulls=NULLS)
    assert d.verdict == "measurement" and d.named == ("ageing",), (d.verdict, d.named, d.probabilities)
    c = cause(d, "ageing")
    assert c.interval[0] <= 0.2 <= c.interval[1]


def test_a_dent_that_stays_is_found_and_is_no_offset():
    """4 % of the deepest earlier travel: none before the first test, more after the deep one."""
    made, reached = [], 0.0
    for e in experiments(6):
        repeats = []
        for r in e.measurement.repeats:
            repeats.append(dataclasses.replace(r, depth=r.depth + 0.04 * reached))
            reached = max(reached, float(r.depth.max()))
        made.append(dataclasses.replace(e, measurement=dataclasses.replace(e.measurement, repeats=tuple(repeats))))
    names = ("stiff", "soften", "offset", "offset_each", "ageing", "permanent_set")
    d = discrepancy.diagnose(build_library(BASE, make_test_plan(made), toy.effects(*names), toy.run), 6, nulls=NULLS)
    assert d.verdict == "measurement" and d.named == ("permanent_set",), (d.verdict, d.named, d.probabilities)
    c = cause(d, "permanent_set")
    assert c.interval[0] <= 0.04 <= c.interval[1]


def test_a_look_alike_makes_it_ambiguous():
    found = [diagnose(seed, {"stiff": 0.6}, names=("stiff", "twin", "soften")) for seed in range(3)]
    for d in found:
        assert d.verdict == "ambiguous" and set(d.named) == {"stiff", "twin"}, (d.verdict, d.named)


def test_offsets_that_differ_from_curve_to_curve_are_the_measurement():
    names = ("stiff", "soften", "offset", "offset_each")
    found = [diagnose(seed, names=names, each_offset=0.12) for seed in (1, 2, 3)]
    assert sum(d.verdict == "measurement" for d in found if d.p_value <= DIAGNOSIS_SETTINGS.rules.false_alarm) >= 2
    for d in found:  # all of them are: none is singled out
        assert "in one curve" not in " ".join(diagnosis_data(d.bench.library, d, (), None, "")["words"])


@pytest.mark.parametrize("late", [-0.3, 0.3])
def test_the_one_curve_whose_contact_is_off_is_named(late):
    """Which of the curves it was the answer did not say: only by how much contact points scatter."""
    made = experiments(7)
    first = made[0].measurement
    repeats = (
        first.repeats[0],
        dataclasses.replace(first.repeats[1], depth=first.repeats[1].depth - late),
        first.repeats[2],
    )
    made[0] = dataclasses.replace(made[0], measurement=dataclasses.replace(first, repeats=repeats))
    library = build_library(BASE, make_test_plan(made), toy.effects("stiff", "soften", "offset_each"), toy.run)
    d = discrepancy.diagnose(library, 7, nulls=NULLS)
    assert d.verdict == "measurement" and d.named == ("offset_each",), (d.verdict, d.named, d.probabilities)
    found = diagnosis_data(library, d, (), None, "")
    each = found["diagnosis"]["causes"][0]["each"]
    assert [v["experiment"] for v in each] == ["load", "load", "load", "cycle", "deep"]
    off = each[1]
    assert abs(off["value"] - late) < 3 * off["sd"] and off["sd"] < 0.1 * abs(late), each
    said = " ".join(found["words"])
    assert f"in one curve, load {off['label']}: {off['value']:+.2g}" in said, said
    json.dumps(plain(found))


def factors(made: list, each: tuple[float, ...]) -> list:
    """The experiments with a factor on the force of each test."""
    out, k = [], iter(each)
    for e in made:
        repeats = tuple(
            dataclasses.replace(r, channels={"Fz": next(k) * r.channels["Fz"]}) for r in e.measurement.repeats
        )
        out.append(dataclasses.replace(e, measurement=dataclasses.replace(e.measurement, repeats=repeats)))
    return out


def test_two_causes_that_are_believed_together_are_no_rivals_of_a_next_test():
    """What sets them apart settles nothing: "settles the matter with 100 %" was said of it."""
    names = ("stiff", "soften", "bias")
    d = diagnose(2, {"soften": 0.3}, names=names, bias=0.05)
    assert d.verdict == "partly" and set(d.named) == {"soften", "bias"} == {e.name for e in d.chosen.effects}
    assert diagnosis_data(tables(names, False), d, (), None, "")["diagnosis"]["next_test"] == []


def test_a_factor_of_every_test_is_of_the_cell_or_of_the_specimen():
    """Forces scale with the modulus: no record tells a gain that wanders from a body that recovers between tests."""
    made = factors(experiments(6), (0.94, 1.07, 0.98, 1.05, 0.93))
    names = ("stiff", "soften", "gain_each", "offset_each")
    library = build_library(BASE, make_test_plan(made), toy.effects(*names), toy.run)
    d = discrepancy.diagnose(library, 6, nulls=NULLS)
    assert d.verdict == "ambiguous" and d.named == ("gain_each",), (d.verdict, d.named, d.probabilities)
    said = " ".join(diagnosis_data(library, d, (), None, "")["words"])
    assert "every test has its own factor" in said and "known weight" in said


def test_tests_that_differ_by_more_than_is_stated_do_not_hide_what_else_there_is():
    """Gains that scatter by six times of what is stated are noise beside a cause, and a finding where there is none."""
    each = (0.94, 1.07, 0.98, 0.95, 1.04, 1.01)
    for truth, verdict, named in (({}, "ambiguous", ("gain_each",)), ({"soften": 0.3}, "explained", ("soften",))):
        rng, body = np.random.default_rng(6), {**TRUTH, **truth}
        loads = toy.recorded(body, rng, repeats=4)
        cycles = toy.recorded(body, rng, repeats=2, unload=True, earlier=4.0)
        made = [toy.experiment("load", loads), toy.experiment("cycle", cycles, after=("load",))]
        library = build_library(
            BASE, make_test_plan(factors(made, each)), toy.effects("stiff", "soften", "gain_each"), toy.run
        )
        d = discrepancy.diagnose(library, 6, nulls=NULLS)
        assert (d.verdict, d.named) == (verdict, named), (d.verdict, d.named, d.probabilities)


def remembering(seed: int, truth=None, ρ: float = 0.5, sd: float = 3e-3):
    """Four places, one force channel, no repeats; each error is ρ times the one before and something new."""
    rng, made = np.random.default_rng(seed), []
    for k, at in enumerate([(0.0, 0.0), (10.0, 0.0), (0.0, 8.0), (20.0, 0.0)]):
        (r,) = toy.recorded({**TRUTH, **(truth or {})}, rng, point=at, white=0.0, unload=k == 1)
        e = rng.standard_normal(len(r.depth))
        for i in range(1, len(e)):
            e[i] = ρ * e[i - 1] + np.sqrt(1 - ρ**2) * e[i]
        r = dataclasses.replace(r, channels={"Fz": r.channels["Fz"] + sd * e})
        made.append(toy.experiment(f"p{k}", (r,), point=at, noise=Noise(Fz=sd, gain=toy.SCATTER)))
    return make_test_plan(made)


def test_noise_that_remembers_is_no_gap_without_repeats():
    """Every one of these was a gap, two of eight with a cause, where the noise was taken for white.

    Negative control: a real gap is found in the same noise.
    """
    library = build_library(BASE, remembering(0), toy.effects("stiff", "skin", "soften"), toy.run)

    def verdicts(count: int, **truth: float) -> list[str]:
        plans = [dataclasses.replace(library, plan=remembering(seed, truth)) for seed in range(count)]
        return [discrepancy.diagnose(one, seed, nulls=NULLS).verdict for seed, one in enumerate(plans)]

    assert (
        verdicts(8).count("no_gap") >= 6
    )  # 5 % each: two alarms of eight come by chance in 6 % of cases, three in 0.6 %
    assert verdicts(3, skin=5.0).count("no_gap") == 0


def test_what_is_stated_binds_only_where_a_gap_is_found_by_it():
    """Gains of 6 % and nothing in the catalogue that has them: no gap was said to be one, of readings not smooth."""
    rng = np.random.default_rng(6)
    loads = toy.recorded(TRUTH, rng, repeats=4, scatter=0.0)
    cycles = toy.recorded(TRUTH, rng, repeats=2, unload=True, earlier=4.0, scatter=0.0)
    made = [toy.experiment("load", loads), toy.experiment("cycle", cycles, after=("load",))]
    plan = make_test_plan(factors(made, (0.934, 1.072, 0.97, 1.024, 1.018, 0.988)))
    library = build_library(BASE, plan, toy.effects("stiff", "soften"), toy.run)
    d = discrepancy.diagnose(library, 3, nulls=NULLS)
    said = " ".join(diagnosis_data(library, d, (), None, "")["words"])
    assert d.verdict == "no_gap" and "taken for noise" in said
    assert "counts as a gap" not in said and "not smooth" not in said


def test_the_cause_is_chosen_anew_without_the_curve_that_is_left_out():
    """The deep test alone was done on a body that stiffens: without it there is nothing."""
    names = ("stiff", "soften")
    made = [*experiments(1)[:2], experiments(1, {"stiff": 0.25})[2]]
    library = dataclasses.replace(tables(names, False), plan=make_test_plan(made))
    y, (stiff, _) = library.plan.values(), library.effects
    evidence = attribution.Evidence(bench := attribution.set_up(library, y), library.effects)
    shrunk = left_out_gaps(library, bench, evidence, y, Hypothesis((stiff,)), 0)
    causes = {c.curve: c.cause for c in shrunk.curves}
    assert causes["deep"] == () and ("stiff",) in causes.values()
    curves = [{"curve": k, "cause": list(v)} for k, v in causes.items()]
    assert "none without deep" in _otherwise({"chosen": ["stiff"], "shrinkage": {"curves": curves}}, {})


def test_the_model_before_is_the_one_that_the_study_found():
    """A modulus that is 20 % off leaves a gap on the validate curve before, and a re-fit alone closes it."""
    made = make_test_plan(experiments(3, validate=True))
    library = dataclasses.replace(tables(NAMES, True), plan=made)
    own, right, off = (
        discrepancy.diagnose(library, 7, nulls=NULLS, fitted=f).shrinkage
        for f in (None, {"mu": TRUTH["mu"]}, {"mu": 1.2 * TRUTH["mu"]})
    )
    assert own.fitted is None and right.fitted == {"mu": TRUTH["mu"]}
    assert right.before < 3.0 < 10.0 * right.before < off.before  # a fifth of the force, known to about 1 %
    assert own.refit_only == right.refit_only == off.refit_only


def test_the_runner_up_is_simulated_even_where_the_winner_is_in_all_that_is_probable():
    d = diagnose(1, {"soften": 0.3})
    leading = [set(k.split(" + ")) for k, _ in sorted(d.probabilities.items(), key=lambda v: -v[1])[:4]]
    assert all("soften" in v for v in leading)
    none, winner, other = (c.hypothesis for c in d.checks)
    assert none == "none" and "soften" in winner and "soften" not in other


@pytest.mark.parametrize("clip", [False, True])
def test_what_is_kept_for_validation_never_influences_the_verdict(clip):
    """Other values there, the same verdict to the last bit, that of a part too; only the shrinkage may move."""
    made = experiments(3, {} if clip else {"soften": 0.2}, validate=True)
    one, other = (clipped("cycle", made) if clip else list(made) for _ in range(2))
    one = make_test_plan(one)
    (r,) = other[2].measurement.repeats
    moved = dataclasses.replace(r, channels={"Fz": 1.4 * r.channels["Fz"] + 0.05})
    other[2] = dataclasses.replace(other[2], measurement=dataclasses.replace(other[2].measurement, repeats=(moved,)))
    library = tables(NAMES, True)
    found = [
        discrepancy.diagnose(dataclasses.replace(library, plan=p), 7, nulls=NULLS) for p in (one, make_test_plan(other))
    ]
    a, b = (verdict(d) for d in found)
    assert a == b
    assert found[0].shrinkage.before != found[1].shrinkage.before
    assert "validate" in found[0].shrinkage.how
    if clip:
        assert found[0].verdict == "unexplained"
    else:
        assert found[0].shrinkage.with_cause < found[0].shrinkage.before


def verdict(d: Diagnosis) -> str:
    """Everything but the shrinkage, as text."""
    rows = [(g.experiment, g.channel, g.region, g.z) for g in d.where.regions]
    causes = [(c.effect.name, c.probability, c.size, c.interval) for c in d.causes]
    held = [(h.experiment, dict(h.gain)) for h in d.held_out]
    checks = [dataclasses.astuple(c) for c in d.checks]
    data = [
        d.verdict,
        d.p_value,
        d.statistic,
        d.named,
        d.probabilities,
        d.sensitivity,
        rows,
        causes,
        held,
        checks,
        d.parameters,
    ]
    return json.dumps(plain(data))


def test_probabilities_are_probabilities():
    d = diagnose(1, {"skin": 2.5})
    np.testing.assert_allclose(sum(d.probabilities.values()), 1.0, rtol=1e-9)
    assert all(0 <= c.probability <= 1 + 1e-9 for c in d.causes)
    for c in d.checks:
        assert 0 <= c.returned <= 1 and 0 <= c.no_gap <= 1 and 0 <= c.in_set <= 1


def test_one_curve_alone_is_answered_humbly():
    """A gap of one curve has no held-out prediction: that is no proof against a cause, and no cause is sure."""
    rng = np.random.default_rng(0)
    repeats = toy.recorded({**TRUTH, "soften": 0.3}, rng, unload=True)
    plan = make_test_plan([toy.experiment("cycle", repeats)])
    library = build_library(BASE, plan, toy.effects("soften", "stiff"), toy.run)
    d = discrepancy.diagnose(library, 0, nulls=NULLS)
    assert d.verdict in ("explained", "ambiguous", "partly") and "soften" in d.named
    assert d.held_out == () and d.shrinkage.closed is None
    story = discrepancy.diagnosis_data(library, d, (), None, "one curve")
    assert any("one curve" in line for line in story["words"])


@pytest.mark.parametrize("names", [("offset_each",), ("stiff",), ("gain_each", "stiff")])
def test_a_short_catalogue_is_a_catalogue(names):
    d = diagnose(0, names=names)
    assert d.verdict == "no_gap" or d.p_value <= DIAGNOSIS_SETTINGS.rules.false_alarm


def test_nothing_stated_and_no_repeats():
    rng = np.random.default_rng(1)
    curves = [toy.recorded(TRUTH, rng, peak=p, readings=10) for p in (3.0, 4.0)]
    plan = make_test_plan([toy.experiment(f"c{k}", r, noise=Noise()) for k, r in enumerate(curves)])
    library = build_library(BASE, plan, toy.effects("stiff", "skin"), toy.run)
    assert discrepancy.diagnose(library, 0, nulls=NULLS).verdict in ("no_gap", "ambiguous", "explained")


def test_failed_runs_everywhere_are_no_evidence():
    """An effect without any answer cannot be the cause, whatever the data say."""
    failing = [
        dataclasses.replace(e, settings={**e.settings, "fail": "soften", "fail_all": True})
        for e in experiments(0, {"soften": 0.35})
    ]
    library = build_library(BASE, make_test_plan(failing), toy.effects("soften", "stiff"), toy.run)
    d = discrepancy.diagnose(library, 0, nulls=NULLS)
    assert "soften" not in d.named and library.failed


def screwed(e, size: float, pitch: float):
    """An experiment whose recorded depths swing about the true ones, as a lead screw's do."""

    def read(r):
        return dataclasses.replace(r, depth=r.depth + size * np.sin(2 * np.pi * r.depth / pitch))

    repeats = tuple(map(read, e.measurement.repeats))
    return dataclasses.replace(e, measurement=dataclasses.replace(e.measurement, repeats=repeats))


@pytest.mark.parametrize("menu, seen", [(DIAGNOSIS_SETTINGS.priors.gaps, True), (((0.03, 0.2), (0.15, 0.2)), False)])
def test_a_gap_that_is_small_and_rough_is_seen(menu, seen):
    """0.025 mm in 1.3 mm: a competitor that is only smooth, or only large, finds it less probable than nothing."""
    plan = make_test_plan([screwed(e, 0.025, 1.3) for e in experiments(3)])
    library = dataclasses.replace(tables(NAMES, False), plan=plan)
    opened = _opened(library, plan.values(), NULLS, 3, with_priors(gaps=menu, alone=()))
    assert opened.gap == seen
    assert not seen or opened.first.hypotheses[int(np.argmax(opened.first.probability))] == Hypothesis((), True)


def test_a_hum_is_no_smooth_gap_and_yet_not_nothing():
    """Readings that swing about the model by more than they scatter: no cause, and not `no_gap` either."""
    phase = iter(np.random.default_rng(5).uniform(0.0, 2 * np.pi, 99))

    def hums(r):
        hum = 0.02 * np.sin(2 * np.pi * r.time / 0.9 + next(phase))
        return dataclasses.replace(r, channels={"Fz": r.channels["Fz"] + hum})

    every = [
        dataclasses.replace(
            e, measurement=dataclasses.replace(e.measurement, repeats=tuple(map(hums, e.measurement.repeats)))
        )
        for e in experiments(3)
    ]
    d = discrepancy.diagnose(dataclasses.replace(tables(NAMES, False), plan=make_test_plan(every)), 3, nulls=NULLS)
    assert d.verdict == "unexplained" and not d.causes
    assert diagnose(3).verdict == "no_gap"


def test_shares_of_the_gap_add_up_and_lead_and_without_a_gap_there_are_none():
    d = diagnose(1, {"skin": 2.5})
    held = {(g.experiment, g.channel): g.share for g in d.where.regions}
    np.testing.assert_allclose(sum(held.values()), 1.0, rtol=1e-9)
    assert d.where.regions[0].share == max(held.values())
    none = diagnose(3)
    assert none.verdict == "no_gap" and not any(g.share for g in none.where.regions)
    z = [abs(g.z) for g in none.where.regions]
    assert z == sorted(z, reverse=True)


def test_of_a_single_curve_none_stands_out():
    off = {"experiment": "load", "label": "1", "value": 0.3, "sd": 0.02}
    said = {"effect": "offset_each", "unit": "mm", "each": [off]}
    assert _single({"causes": [said]}, {}) == ""
    others = [{**off, "label": "2", "value": 0.01}, {**off, "label": "3", "value": -0.02}]
    assert "in one curve, load 1: +0.3" in _single({"causes": [{**said, "each": [off, *others]}]}, {})


@pytest.mark.parametrize("tau", [3.0, 20.0])
def test_what_shapes_a_cause_is_said_with_it(tau):
    """A relaxation time beside the share that relaxes; an effect of one knob has no shape."""
    d = diagnose(3, {"g": 0.3, "tau": tau}, names=("g", "stiff"))
    (low, mid, high), unit = cause(d, "g").shape[0], "s"
    assert low <= tau <= high and low < mid < high
    (said,) = diagnosis_data(d.bench.library, d, (), None, "")["diagnosis"]["causes"]
    assert said["shape"] == [{"knob": "tau", "unit": unit, "size": mid, "interval": [low, high]}]
    assert _named(said).endswith(f" with tau = {mid:.3g} s ({low:.3g} to {high:.3g})")
    stiff = diagnose(3, {"stiff": 0.3}, names=("stiff",))
    assert cause(stiff, "stiff").shape == ()


def test_what_the_data_neither_show_nor_exclude_widens_the_interval():
    """A cell that shows 5 % too little looks like a softer body: mu is wrong if nothing is missing, and held by the
    interval where the cell is known to 5 % only.

    Negative controls: a cell that is known well, and nothing else that could be there, leave the interval as it is.
    """

    def found(seed: int, **known: float) -> marginal_ranges.Reach:
        library = tables(("compliance", "gain"), False)
        effects = tuple(dataclasses.replace(e, known=known.get(e.name)) for e in library.effects)
        plan = make_test_plan(experiments(seed, {"mu": 0.95 * TRUTH["mu"], "D1": TRUTH["D1"] / 0.95}))
        d = discrepancy.diagnose(dataclasses.replace(library, plan=plan, effects=effects), seed, NULLS)
        assert d.verdict == "no_gap"
        r = d.reach["mu"]
        assert (d.parameters["after"]["mu"], d.parameters["if_nothing_else"]["mu"]) == (r.whole, r.alone)
        return r

    holds = lambda v: v[0] <= TRUTH["mu"] <= v[2]  # noqa: E731
    rough = [found(seed, gain=0.05) for seed in (200, 201, 202)]
    assert all(holds(r.whole) for r in rough) and not any(holds(r.alone) for r in rough)
    usual, sure = found(200), found(200, gain=0.0, compliance=0.0)
    assert width(sure.alone) < width(usual.whole) < 0.7 * width(rough[0].whole)
    assert abs(width(sure.whole) / width(sure.alone) - 1.0) < 0.05 and not holds(sure.whole)


def test_what_widens_an_interval_most_is_named():
    """The effect without which it is narrow; none where all widen it alike little, nor what is never there."""
    rng, quantiles = np.random.default_rng(0), lambda v: tuple(map(float, np.quantile(v, [0.05, 0.5, 0.95])))
    own, there = rng.standard_normal(4000), rng.random(4000) < 0.4
    other = rng.random(4000) < 0.5
    names = {"train": there, "other": other}
    r = marginal_ranges._told(own + 8.0 * there * rng.random(4000), quantiles(own), names, quantiles)
    assert r.by == ("train",) and r.high_with == "train" and r.low_with is None
    assert width(r.without) < 1.1 * width(r.alone) < 0.6 * width(r.whole)
    assert marginal_ranges._told(own + 0.3 * other, quantiles(own), names, quantiles).by == ()


def width(v: tuple[float, float, float]) -> float:
    return v[2] - v[0]


def test_beside_a_cause_that_is_found_another_may_move_the_modulus():
    """Softening is seen on the way back; that the body stiffens a little, too, is not, and moves the modulus."""
    held, wider = [], []
    for seed in range(4):
        d = diagnose(seed, {"soften": 0.3, "stiff": 0.03}, names=("stiff", "soften"))
        assert d.verdict == "explained" and d.named == ("soften",)
        r = d.reach["mu"]
        assert {r.low_with, r.high_with, *r.by} <= {None, "stiff"}  # never what is there already
        held.append(r.whole[0] <= TRUTH["mu"] <= r.whole[2])
        wider.append(width(r.whole) / width(r.alone))
    assert all(held) and min(wider) > 0.97 and max(wider) > 1.05, (held, wider)


def test_an_effect_added_by_its_shift_has_the_evidence_of_the_pair():
    """Tiles of both effects at once are the oracle: ln evidence within 1, ends of the modulus within 1 %."""
    library, names = tables(("stiff", "soften"), False), ("soften", "stiff")
    plan = make_test_plan(experiments(1, {"soften": 0.3, "stiff": 0.12}))
    library = dataclasses.replace(library, plan=plan)
    y = plan.values()
    evidence = Evidence(set_up(library, y), library.effects)
    first, second = (next(e for e in library.effects if e.name == n) for n in names)
    said, rng = Hypothesis((first,)), np.random.default_rng(0)
    h = evidence.best(said.effects, y, loose=True)
    (added,) = marginal_ranges._unseen(evidence, h, said, posterior(h, h.white(y), 1000, rng), y, rng)
    assert added.effect is second
    both = evidence.best((first, second), y, loose=True)
    want = mixture_log_evidence(both, both.white(y)[None])[0]
    assert (
        abs(
            mixture_log_evidence(h, h.white(y)[None])[0]
            + logsumexp(added.gained)
            - np.log(marginal_ranges.N_UNSEEN_SIZE_DRAWS)
            - want
        )
        < 1.0
    )
    exact = posterior(both, both.white(y), 4000, rng).modulus
    sure = dataclasses.replace(added, prior=1.0)
    drawn, there = marginal_ranges._averaged(evidence, h, said, [sure], y, 4000, rng)
    assert there.all()
    np.testing.assert_allclose(np.quantile(drawn["mu"], [0.05, 0.95]), np.quantile(exact, [0.05, 0.95]), rtol=0.01)


def test_the_average_holds_all_hypotheses_by_their_probability():
    """What the contest leaves possible counts; what is said counts half, where the contest was taken back."""
    library = tables(NAMES, False)
    stiff, skin = (Hypothesis((next(e for e in library.effects if e.name == n),)) for n in ("stiff", "skin"))
    none, s = Hypothesis(()), np.log([0.7, 0.29, 0.01 - 1e-4, 1e-4])
    contest = attribution.Comparison((none, stiff, skin, Hypothesis((), True)), s, np.zeros(4))
    shares = marginal_ranges._shares(contest, none)
    assert list(shares) == [none, stiff, skin] and abs(sum(shares.values()) - 1.0) < 1e-12
    assert abs(shares[none] - 0.7) < 0.01 and abs(shares[stiff] - 0.29) < 0.01
    back = marginal_ranges._shares(contest, Hypothesis((), True))
    assert back[Hypothesis((), True)] == 0.5 and abs(back[none] / back[stiff] - 0.7 / 0.29) < 1e-9


@pytest.mark.parametrize("walls", [False, True])
def test_one_draw_of_each_data_set_is_the_posterior_of_each(walls):
    """Alike data sets drawn at once are draws of one posterior; different ones have their own means."""
    library = tables(("stiff",), False)
    y = library.plan.values()
    h = Evidence(set_up(library, y), library.effects).ready(library.effects if walls else ())
    w = h.white(np.stack([y, 1.1 * y]))
    rng = np.random.default_rng(0)
    each = posterior_each(h, np.repeat(w, 4000, axis=0), rng).modulus.reshape(2, -1)
    for k in range(2):
        one = posterior(h, w[k], 4000, rng).modulus
        many, alone = (np.quantile(v, [0.05, 0.5, 0.95]) for v in (each[k], one))
        np.testing.assert_allclose(many, alone, rtol=3e-3)


def test_what_a_plan_can_see_is_what_the_verdict_finds():
    """The verdict asks besides that a gap be more probable than none: powers were those of a laxer rule."""
    from rso.discrepancy.evidence import detectable as room

    lax = dataclasses.replace(
        DIAGNOSIS_SETTINGS, rules=dataclasses.replace(DIAGNOSIS_SETTINGS.rules, false_alarm=0.5)
    )  # as a poor plan's 5 % are
    library = tables(NAMES, False)
    y = library.plan.values()
    evidence = attribution.Evidence(attribution.set_up(library, y, settings=lax), library.effects)
    null = np.array([c.statistic for c in attribution.comparisons(evidence, attribution.nulls(evidence, y, 400, 5))])
    assert np.quantile(null, 0.5) < 0.0 and np.mean(null > 0.0) < 0.1
    base, rng, over = evidence.ready(()), np.random.default_rng(3), []
    centre = base.tiles.at[int(np.argmax(room.log_tiles(base, base.white(y)[None])[0]))]
    for seen in room.detectable(evidence, y, 0):
        r = evidence.ready((seen.effect,))
        for t, (_, power) in zip(room._ladder(evidence, seen.effect, centre), seen.power, strict=True):
            Y = base.white.L @ r.middle(t) + rng.standard_normal((100, len(y))) @ base.white.L.T
            over.append(power - np.mean([c.statistic > 0.0 for c in attribution.comparisons(evidence, Y)]))
    assert abs(np.mean(over)) < 0.05, over


def test_what_is_seen_without_ever_being_clear_has_rivals_too(monkeypatch):
    """With no size found in nine of ten data sets it was said to be recognised in 0 % and to look like nothing else."""
    from rso.discrepancy.evidence import detectable as room

    library = tables(NAMES, False)
    y = library.plan.values()
    evidence = attribution.Evidence(attribution.set_up(library, y), library.effects)
    monkeypatch.setattr(room, "MIN_POWER_FOR_CONFUSION", 1.0)
    seen = [d for d in room.detectable(evidence, y, 0) if d.limit is not None]
    assert len(seen) > 2
    assert all(d.recognised > 0.1 for d in seen)


def test_the_verdict_is_said_before_tests_that_could_settle_it_are_simulated():
    """They may take as long as the library did, and who stopped waiting had heard nothing."""
    from types import SimpleNamespace

    from rso.discrepancy.study_diagnosis import judge_library

    library = dataclasses.replace(tables(NAMES, False), plan=make_test_plan(experiments(0, bias=0.02)))
    said: list[str] = []
    asked = SimpleNamespace(study=SimpleNamespace(study=SimpleNamespace(seed=0, title="")))
    found = judge_library(asked, library, None, said.append)["diagnosis"]
    assert f"the verdict is {found['verdict']} ({found['causes'][0]['effect']}" in said[-1]
    before = [line for line in said[: said.index("verdict: evidence, held-out prediction and self-checks")]]
    limit = {v["effect"]: v for v in found["detectable"]}
    shown, value = next((n, v["smallest_visible"]) for n, v in limit.items() if v["smallest_visible"])
    assert f"{shown} " in before[1] and f"{value:.3g}" in before[1], "limits are told before causes meet the data"
