"""Open the sealed truths and score the answers.

python benchmarks/blind/score.py --cases DIR [DIR ...] --answers DIR [DIR ...] [--json FILE] [--classes FILE]
answers/case_0001.json holds the block "diagnosis" of results.json (or results.json itself). --classes: JSON list of
lists of answer names that the diagnosis declared, before the data, to be indistinguishable with this test plan; then
top-1 and set figures are also given over these classes. Hashes are verified first. Intervals: Clopper-Pearson, 95 %.
Cases of a second folder are numbered 1000 higher, of a third 2000. An answer may hold "rival", what another rule says
of the same data ({"gap", "best", "named"}, see benchmarks/blind_answers.py): then its figures are given beside.
Needs numpy and scipy only.
"""

import argparse
import hashlib
import json
from collections import Counter
from pathlib import Path

import numpy as np
from catalogue import ANSWERS as OF_ELLIPSOID
from catalogue import LISTED, SINGLE
from flat import ANSWERS as OF_FLAT
from flat import LISTED as LISTED_FLAT
from scipy.optimize import minimize
from scipy.stats import beta

ANSWERS = OF_ELLIPSOID | OF_FLAT
VISIBLE = 4.0  # signal below which "no_gap" is also right, and which "detectable" refers to
STRONG = 16.0  # signal of an effect that nobody would overlook
CONFIDENT = 0.8
ALONE = ("explained", "measurement")  # verdicts that name one cause
# what the main number of a truth is in the units of the answer: truth record, mu -> value
SIZES = {
    "C20": lambda t, mu: t["C20_over_mu"] * mu,
    "C30": lambda t, mu: t["C30_over_mu"] * mu,
    "alpha": lambda t, mu: t["alpha"],
    "prony_g": lambda t, mu: t["prony_g"],
    "prony_tau": lambda t, mu: t["prony_tau_s"],
    "skin_ratio": lambda t, mu: t["skin_ratio"],
    "skin_thickness": lambda t, mu: t["skin_thickness"],
    "inclusion_ratio": lambda t, mu: t["ratio"],
    "delta_a": lambda t, mu: t["delta_mm"],
    "delta_b": lambda t, mu: t["delta_mm"],
    "delta_c": lambda t, mu: t["delta_mm"],
    "delta_R": lambda t, mu: t["delta_mm"],
    "delta_thickness": lambda t, mu: t["delta_mm"],
    "delta_height": lambda t, mu: t["delta_mm"],
    "delta_radius": lambda t, mu: t["delta_mm"],
    "substrate_compliance": lambda t, mu: t["compliance_mm_per_MPa"],
    "plate_friction": lambda t, mu: t["mu_plate"],
    "weight": lambda t, mu: t["specific_weight_N_per_mm3"],
    "friction": lambda t, mu: t["mu_f"],
    "adhesion": lambda t, mu: t["work_N_per_mm"],
    "bowl_clearance": lambda t, mu: t["clearance_mm"],
    **{
        k: (lambda t, mu, k=k: t[k])
        for k in ("offset_x", "offset_y", "tilt_x", "tilt_y", "compliance", "gain", "bias", "drift", "lag")
    },
    **{k: (lambda t, mu, k=k: t[k]) for k in ("offset", "cross_x", "cross_y")},
}


def clopper_pearson(k, n, level=0.95):
    """Exact binomial interval for k of n."""
    if n == 0:
        return 0.0, 1.0
    a = (1 - level) / 2
    low = 0.0 if k == 0 else float(beta.ppf(a, k, n - k + 1))
    high = 1.0 if k == n else float(beta.ppf(1 - a, k + 1, n - k))
    return low, high


def read(cases, answers):
    """Pairs (truth, diagnosis or None), sorted by number; raises ValueError where a hash does not match."""
    hashes = {}
    for line in (cases / "hashes.txt").read_text().split("\n"):
        if line.strip():
            name, digest = line.split()
            hashes[name] = digest
    pairs = []
    for name, digest in sorted(hashes.items()):
        blob = (cases / "sealed" / f"{name}.json").read_bytes()
        if hashlib.sha256(blob).hexdigest() != digest:
            raise ValueError(f"{name}: the sealed truth does not match its published hash")
        path = answers / f"{name}.json"
        answer = json.loads(path.read_text()) if path.exists() else None
        found = passed(answer.get("diagnosis", answer)) if answer and "error" not in answer else None
        pairs.append((json.loads(blob), {**found, "rival": answer.get("rival")} if found else None))
    return pairs


def together(cases, answers):
    """Pairs of several folders, (truth, answer) of :func:`read`; those of the k-th are numbered 1000 k higher."""
    pairs = []
    for k, (of, by) in enumerate(zip(cases, answers, strict=True)):
        for truth, answer in read(of, by):
            number = int(truth["id"].removeprefix("case_")) + 1000 * k
            pairs.append(({**truth, "id": f"case_{number:04d}"}, answer))
    return pairs


def of_rival(answer):
    """What the rival says as an answer: a gap without a name is unexplained, one name is sure, several are a set."""
    said = answer["rival"]
    names = [said["best"], *(n for n in said["named"] if n != said["best"])] if said["named"] else []
    kinds = ("unexplained", "explained") if len(names) < 2 else ("ambiguous",)
    verdict = kinds[-1 if names else 0] if said["gap"] else "no_gap"
    found = [{"effect": n, "cause": n, "probability": 1.0 / len(names) - 1e-6 * k} for k, n in enumerate(names)]
    return passed({"verdict": verdict, "causes": found, "ambiguous_with": [[n] for n in names], "where": []})


def passed(diagnosis):
    """The answer as it is scored: by cause, and with exact names beside."""
    return {**by_cause(diagnosis), "exact": by_cause(diagnosis, exact=True)}


def by_cause(diagnosis, exact=False):
    """The answer with forms of one cause under the name of the catalogue (a filter and a delay are both a lag).

    exact: names with a place, and those of `catalogue.LISTED`, stay as they were given.
    """
    known, listed = (set().union(*names.values()) for names in (ANSWERS, LISTED | LISTED_FLAT))
    names = {
        c["effect"]: c["cause"]
        for c in diagnosis.get("causes") or []
        if c["effect"] not in known
        and c.get("cause") in known
        and not (exact and (c["effect"] in listed or " at (" in c["effect"]))
    }
    found = [{**c, "effect": names.get(c["effect"], c["effect"])} for c in diagnosis.get("causes") or []]
    groups = [g if isinstance(g, str) else [names.get(n, n) for n in g] for g in diagnosis.get("ambiguous_with") or []]
    return {**diagnosis, "causes": found, "ambiguous_with": groups}


def causes(diagnosis):
    """Causes, most probable first."""
    return sorted(diagnosis.get("causes") or [], key=lambda c: -(c.get("probability") or 0.0))


def top(diagnosis):
    """Name of the leading cause, or None where none is claimed."""
    found = causes(diagnosis)
    return found[0]["effect"] if found and diagnosis["verdict"] not in ("no_gap", "unexplained") else None


def named_set(diagnosis):
    """Effects named: the leading cause and what it is ambiguous with."""
    leader = top(diagnosis)
    if leader is None:
        return set()
    named = {leader}
    for group in diagnosis.get("ambiguous_with") or []:
        group = {group} if isinstance(group, str) else set(group)
        if leader in group or len(group) == 1 or diagnosis["verdict"] == "ambiguous":
            named |= group
    return named


def accepted(truth):
    """Answer names of each effect of a truth, list of sets."""
    return [ANSWERS[e["name"]] for e in truth["effects"] if e["name"] in ANSWERS]


def widen(names, classes):
    """Names together with those declared indistinguishable from them."""
    return set(names).union(*(set(c) for c in classes if set(c) & set(names)), set())


def rate(hits):
    """List of booleans -> {k, n, rate, low, high}."""
    k, n = int(sum(hits)), len(hits)
    low, high = clopper_pearson(k, n)
    return {"k": k, "n": n, "rate": k / n if n else None, "low": low, "high": high}


def limit_of_detection(signals, found):
    """Signal with 50 % power, by logistic regression on its logarithm; None with too little to go by."""
    s, y = np.log(np.maximum(signals, 1e-3)), np.asarray(found, float)
    if len(y) < 8 or y.min() == y.max():
        return None

    def loss(p):
        z = np.exp(p[1]) * (s - p[0])
        return np.sum(np.logaddexp(0, z) - y * z) + 0.01 * p[1] ** 2

    return float(np.exp(minimize(loss, [np.log(VISIBLE), 0.5], method="Nelder-Mead").x[0]))


def covered(truth, diagnosis):
    """Whether the interval of the leading cause holds the true size; None where not comparable."""
    leader = causes(diagnosis)[0]
    effect = truth["effects"][0]
    if leader["effect"] not in SIZES or leader["effect"] not in ANSWERS[effect["name"]] or not leader.get("interval"):
        return None
    try:
        value = SIZES[leader["effect"]](effect["truth"], truth["material"]["mu"])
    except KeyError:
        return None
    if leader["effect"] == "gain" and leader.get("neutral") == 0:
        value -= 1
    if leader["effect"].startswith("tilt") and leader.get("unit") == "rad":
        value = np.radians(value)
    low, high = sorted(leader["interval"])
    if leader["effect"] in ("tilt_x", "tilt_y", "offset_x", "offset_y", "offset") and not low <= value <= high:
        return bool(low <= -value <= high)  # signs of these are a convention: the size is what is compared
    return bool(low <= value <= high)


def shrinkage_share(diagnosis):
    """(before - with_cause)/(before - floor), or None."""
    s = diagnosis.get("shrinkage") or {}
    try:
        gap = s["before"] - s["noise_floor"]
        return (s["before"] - s["with_cause"]) / gap if gap > 0 else None
    except (KeyError, TypeError):
        return None


def right_place(truth, diagnosis, count=2):
    """Whether one of the first `count` force curves named is one where the effect truly stands out most.

    Profiles do not count: a truth holds the places of largest chi^2 among the forces only.
    """
    true = {(w["experiment"], w["channel"]) for w in truth.get("where", [])[:3]}
    named = [(w.get("experiment", ""), w.get("channel", "")) for w in diagnosis.get("where") or []]
    named = [place for place in dict.fromkeys(named) if place[1] != "uz"][:count]
    return any(e == a and c == b for e, c in named for a, b in true)


def as_asked(truth, diagnosis):
    """The answer with exact names where the truth holds names in a catalogue (out of catalogue, from round 8 on)."""
    return diagnosis.get("exact", diagnosis) if "listed" in truth["allowed"] else diagnosis


def acceptable(truth, diagnosis):
    """Whether the verdict is among those published in advance for this truth."""
    allowed, diagnosis = truth["allowed"], as_asked(truth, diagnosis)
    if diagnosis["verdict"] in ALONE and top(diagnosis) in allowed.get("listed", ()):
        return True
    if diagnosis["verdict"] == "explained":
        return top(diagnosis) in allowed["causes"]
    if diagnosis["verdict"] == "ambiguous" and allowed["causes"] and named_set(diagnosis) & set(allowed["causes"]):
        return True
    return diagnosis["verdict"] in allowed["verdicts"]


def figures(pairs, classes=()):
    """All figures of the round, a JSON-able dict."""
    pairs = [(t, d) for t, d in pairs if d is not None]
    kind = {k: [(t, d) for t, d in pairs if t["kind"] == k] for k in ("null", "single", "pair", "outside")}
    gap = lambda d: d["verdict"] != "no_gap"  # noqa: E731
    single = kind["single"]
    unlisted = [(t, d) for t, d in kind["outside"] if not t["allowed"].get("listed")]
    limit = limit_of_detection([t["signal"] for t, _ in single], [gap(d) for _, d in single])
    strong = [(t, d) for t, d in single if t["signal"] >= (3 * limit if limit else 3 * VISIBLE)]
    seen = [(t, d) for t, d in single if t["signal"] >= VISIBLE and gap(d)]
    hit = lambda t, d, cl=(): top(d) is not None and top(d) in widen(accepted(t)[0], cl)  # noqa: E731
    inside = lambda t, d, cl=(): bool(widen(named_set(d), cl) & accepted(t)[0])  # noqa: E731
    right = [(t, d) for t, d in single if hit(t, d)]
    cover = [c for c in (covered(t, d) for t, d in right) if c is not None]
    shares = [s for s in (shrinkage_share(d) for _, d in right) if s is not None]
    null_shrink = [
        d["shrinkage"]["interval"][0] <= 0 <= d["shrinkage"]["interval"][1]
        for _, d in kind["null"]
        if (d.get("shrinkage") or {}).get("interval")
    ]
    out = {
        "counts": {k: len(v) for k, v in kind.items()},
        "false_alarm": rate([gap(d) for _, d in kind["null"]]),
        "limit_of_detection": limit,
        "detection_visible": rate([gap(d) for t, d in single if t["signal"] >= VISIBLE]),
        "detection_at_3_limits": rate([gap(d) for _, d in strong]),
        "top_1": rate([hit(t, d) for t, d in seen]),
        "top_1_classes": rate([hit(t, d, classes) for t, d in seen]),
        "in_set": rate([inside(t, d) for t, d in seen]),
        "in_set_classes": rate([inside(t, d, classes) for t, d in seen]),
        "top_1_classes_strong": rate([hit(t, d, classes) for t, d in seen if t["signal"] >= STRONG]),
        "named_alone_right": rate([hit(t, d, classes) for t, d in single if d["verdict"] in ALONE]),
        "mean_set_size": float(np.mean([len(named_set(d)) for _, d in seen])) if seen else None,
        "pairs_one_named": rate([any(named_set(d) & a for a in accepted(t)) for t, d in kind["pair"]]),
        "pairs_allowed": rate([acceptable(t, d) for t, d in kind["pair"]]),
        "outside_allowed": rate([acceptable(t, d) for t, d in kind["outside"]]),
        "outside_confidently_wrong": rate([confidently_wrong(t, d) for t, d in kind["outside"]]),
        "unlisted_allowed": rate([acceptable(t, d) for t, d in unlisted]),
        "unlisted_confidently_wrong": rate([confidently_wrong(t, d) for t, d in unlisted]),
        "single_confidently_wrong": rate([confidently_wrong(t, d) for t, d in single]),
        "wrong_and_sure": rate([wrong_and_sure(t, d) for t, d in pairs]),
        "right_place": rate([right_place(t, d) for t, d in seen if t.get("where")]),
        "interval_covers": rate(cover),
        "shrinkage_share_median": float(np.median(shares)) if shares else None,
        "null_shrinkage_holds_0": rate(null_shrink),
        "log_score": log_score(seen),
        "mu_held_before": rate([mu_held(t, d, "before") for t, d in right if "parameters" in d]),
        "mu_held_after": rate([mu_held(t, d, "after") for t, d in right if "parameters" in d]),
        "mu_bias": mu_bias([(t, d) for t, d in right if "parameters" in d]),
        "next_test": "not scored here: it needs a run of the proposed test",
        "confusion": confusion(pairs),
        "visible_by_effect": visible_by_effect(single),
        "by_memory": by_memory(pairs),
    }
    n = len(OF_ELLIPSOID)
    out["baselines"] = {
        "prior_only": {"top_1": float(np.mean([len(accepted(t)[0]) > 0 for t, _ in seen])) / n if seen else None},
        "prior_only_log_score": -float(np.log(n)),
        "always_none": {"false_alarm": 0.0, "detection": 0.0, "top_1": 0.0, "outside_allowed": 0.0},
    }
    out["failures"] = failures(pairs, hit)
    return out


def confidently_wrong(truth, diagnosis):
    """'explained' with probability above CONFIDENT and a cause that is neither true nor allowed."""
    if diagnosis["verdict"] != "explained" or not causes(diagnosis):
        return False
    leader = causes(as_asked(truth, diagnosis))[0]
    return leader["effect"] not in truth["allowed"]["causes"] and (leader.get("probability") or 0) > CONFIDENT


def wrong_and_sure(truth, diagnosis):
    """One cause named alone with probability above CONFIDENT, and neither verdict nor cause is allowed."""
    if diagnosis["verdict"] not in ALONE or not causes(diagnosis):
        return False
    right = set().union(*accepted(truth), set())
    leader = causes(as_asked(truth, diagnosis))[0]
    sure = (leader.get("probability") or 0) > CONFIDENT
    named = top(diagnosis) in right if truth["kind"] in ("single", "pair") else acceptable(truth, diagnosis)
    return sure and not named


def log_score(seen):
    """Mean log probability of the truth over detected single cases (floor 1e-3)."""
    if not seen:
        return None
    p = [sum(c.get("probability") or 0 for c in causes(d) if c["effect"] in accepted(t)[0]) for t, d in seen]
    return float(np.mean(np.log(np.clip(p, 1e-3, 1))))


def by_memory(pairs):
    """{how the noise remembers: [weak cases, those with a gap, visible single effects, those found]}.

    By the coefficient of the noise from one reading to the next; weak is a signal below VISIBLE, whatever the kind.
    """
    table = {}
    for t, d in pairs:
        rho = abs(t.get("noise", {}).get("rho") or 0.0)
        row = table.setdefault("white" if rho < 0.1 else "below 0.5" if rho < 0.5 else "0.5 and more", [0, 0, 0, 0])
        gap = d["verdict"] != "no_gap"
        if t["signal"] < VISIBLE:
            row[:2] = row[0] + 1, row[1] + gap
        elif t["kind"] == "single":
            row[2:] = row[2] + 1, row[3] + gap
    return table


def visible_by_effect(single):
    """{effect: [cases with a signal of VISIBLE and more, those found with the truth in the named set]}."""
    table = {}
    for t, d in single:
        if t["signal"] >= VISIBLE:
            n, k = table.get(t["effects"][0]["name"], (0, 0))
            table[t["effects"][0]["name"]] = (n + 1, k + bool(named_set(d) & accepted(t)[0]))
    return {name: list(v) for name, v in sorted(table.items())}


def mu_bias(right):
    """Median relative error of mu before and after naming the cause, per effect."""
    table = {}
    for t, d in right:
        pair = [d["parameters"][k]["mu"]["median"] / t["material"]["mu"] - 1 for k in ("before", "after")]
        table.setdefault(t["effects"][0]["name"], []).append(pair)
    return {k: np.median(v, axis=0).tolist() for k, v in sorted(table.items())}


def mu_held(truth, diagnosis, when):
    """Whether mu is within 1 % of the truth or its 90 % interval holds it, `before` or `after` naming the cause."""
    p, mu = diagnosis["parameters"][when]["mu"], truth["material"]["mu"]
    return p["low"] <= mu <= p["high"] or abs(p["median"] / mu - 1) <= 0.01


def label(truth):
    """Row of the confusion table."""
    return truth["kind"] if truth["kind"] == "null" else "+".join(e["name"] for e in truth["effects"])


def confusion(pairs):
    """{truth: {answer: count}}, the answer being the leading cause or the verdict without one."""
    table = {}
    for t, d in pairs:
        if t["kind"] != "pair":
            table.setdefault(label(t), Counter())[top(d) or d["verdict"]] += 1
    return {k: dict(v) for k, v in sorted(table.items())}


def failures(pairs, hit):
    """Every case that is not right, one line each."""
    rows = []
    for t, d in pairs:
        wrong = not acceptable(t, d)
        if t["kind"] == "single" and t["signal"] >= VISIBLE:
            wrong = wrong or not (hit(t, d) or named_set(d) & accepted(t)[0])
        if wrong:
            names = [f"{c['effect']} {c.get('probability') or 0:.2f}" for c in causes(d)[:3]]
            rows.append(f"{t['id']} {label(t)} (signal {t['signal']:.1f}): {d['verdict']}, {', '.join(names) or '-'}")
    return rows


def report(f):
    """Text of the figures."""
    lines = ["cases: " + ", ".join(f"{k} {v}" for k, v in f["counts"].items())]
    for key, value in f.items():
        if isinstance(value, dict) and "k" in value:
            shown = "-" if value["rate"] is None else f"{100 * value['rate']:.0f} %"
            lines.append(f"{key:28s} {value['k']}/{value['n']}  {shown}  [{value['low']:.2f}, {value['high']:.2f}]")
        elif key not in ("counts", "confusion", "failures", "baselines", "mu_bias", "rival"):
            lines.append(f"{key:28s} {value}")
    lines.append(f"baselines                    {json.dumps(f['baselines'])}")
    lines.append("mu: error before -> after, by effect")
    lines += [f"  {k:18s} {100 * a:+.1f} % -> {100 * b:+.1f} %" for k, (a, b) in f["mu_bias"].items()]
    lines.append("confusion (truth: answers)")
    lines += [f"  {k:18s} " + ", ".join(f"{a} {n}" for a, n in v.items()) for k, v in f["confusion"].items()]
    lines.append("failures")
    lines += [f"  {row}" for row in f["failures"]] or ["  none"]
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, nargs="+", required=True)
    parser.add_argument("--answers", type=Path, nargs="+", required=True)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--classes", type=Path)
    args = parser.parse_args()
    pairs = together(args.cases, args.answers)
    classes = json.loads(args.classes.read_text()) if args.classes else ()
    result = figures(pairs, classes)
    result["unanswered"] = sum(d is None for _, d in pairs)
    result["bodies"] = sorted({t.get("body", "ellipsoid") for t, d in pairs if d})
    result["effects_without_case"] = sorted(set(SINGLE) - {e["name"] for t, d in pairs if d for e in t["effects"]})
    print(report(result))
    beside = [(t, of_rival(d)) for t, d in pairs if d and d["rival"]]
    if beside:
        result["rival"] = figures(beside, classes)
        print(f"\nthe rival: least squares and BIC\n{report(result['rival'])}")
    if args.json:
        args.json.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
