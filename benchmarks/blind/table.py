"""Figures of all blind rounds side by side, from the scores that `score.py` wrote: table.py reports/blind [--from 3]

Counts of every round on the ellipsoid; those from one round on together, with the 95 % interval of Clopper and Pearson.
The last round, whatever its bodies, also alone, and beside the rival where its answers hold one.
"""

import argparse
import json
import re
from collections import Counter
from pathlib import Path

import numpy as np
from catalogue import OUTSIDE
from score import ANSWERS, clopper_pearson

ROWS = {
    "false_alarm": ("false alarm on null data", "≤ 5 %"),
    "detection_visible": ("found, of single effects with signal ≥ 4", ""),
    "detection_at_3_limits": ("found at 3 × the limit of the round", "≥ 95 %"),
    "top_1_classes": ("right cause on top, of those found", "≥ 90 %"),
    "top_1_classes_strong": ("the same, signal ≥ 16", ""),
    "in_set_classes": ("truth inside the named set", "≥ 97 %"),
    "named_alone_right": ("one cause named alone, and right", ""),
    "pairs_allowed": ("pairs: verdict allowed", ""),
    "pairs_one_named": ("pairs: one of both named", ""),
    "outside_allowed": ("out of catalogue: verdict allowed", "≥ 90 %"),
    "outside_seen": ("the same, without gaps that were not seen", ""),
    "outside_confidently_wrong": ("out of catalogue: confidently wrong", "≤ 3 %"),
    "named_and_wrong": ("the same, and where a wrong cause is called the measurement", "≤ 3 %"),
    "unlisted_allowed": ("the same, without kinds that a catalogue holds by then: allowed", ""),
    "unlisted_confidently_wrong": ("the same: confidently wrong", ""),
    "right_place": ("right region among the first two", "≥ 90 %"),
    "interval_covers": ("90 % interval of the size holds the truth", "85–95 %"),
    "mu_held_before": ("μ within 1 % or its interval, base model", ""),
    "mu_held_after": ("the same, cause named", ""),
}
UNSEEN = re.compile(r"case_\d+ (\w+) \(.*\): no_gap, .*")
SURE = re.compile(r"case_\d+ (\w+) \(.*\): (?:explained|measurement), .* (?:0\.[89]\d|1\.00)")
BOOTSTRAPS, WORST = 4000, 6
PLAIN = {
    "limit_of_detection": ("limit of detection (signal)", ""),
    "mean_set_size": ("mean set size", "≤ 2"),
    "shrinkage_share_median": ("share closed, median where the cause is right", "≥ 0.9"),
    "log_score": ("mean log score (prior alone −3.47)", "far above"),
}


def together(rounds):
    """k of n over rounds, its rate and interval, in words."""
    k, n = (sum(r[part] for r in rounds) for part in ("k", "n"))
    if not n:
        return "–"
    low, high = clopper_pearson(k, n)
    return f"{k} of {n}: {100 * k / n:.0f} % ({100 * low:.0f}–{100 * high:.0f} %)"


def named_and_wrong(a_round):
    """Cases outside the catalogue whose verdict is not allowed and whose one cause has 0.8 and more.

    As `confidently wrong`, which counts what is `explained` alone, and what is called the measurement besides.  From
    the failures, so that it holds for rounds that were scored before.
    """
    found = [m[1] for m in map(SURE.fullmatch, a_round["failures"]) if m]
    return {"k": sum(name in OUTSIDE for name in found), "n": a_round["counts"]["outside"]}


def outside_seen(a_round):
    """`outside_allowed` without the failures that are `no_gap`: what is said of a gap once it is seen."""
    missed = [m[1] for m in map(UNSEEN.fullmatch, a_round["failures"]) if m]
    allowed = a_round["outside_allowed"]
    return {"k": allowed["k"], "n": allowed["n"] - sum(name in OUTSIDE for name in missed)}


def macro_average(rounds, names):
    """Mean over effects of the share of right answers, its interval by a bootstrap of the effects, and the worst three.

    Each effect counts alike, however many cases it has.  An answer is right where the rules allow its verdict and, of
    a visible single effect, its causes; a failure is what the score lists.
    """
    number, wrong = Counter(), Counter()
    for r in rounds:
        number.update({k: sum(v.values()) for k, v in r["confusion"].items() if k in names})
        wrong.update(name for row in r["failures"] for name in [row.split()[1]] if name in names)
    return shares(number, {k: number[k] - wrong[k] for k in number})


def shares(number, right):
    """The sentence of :func:`macro_average` from the cases of each effect and those that are right."""
    if not number:
        return "–"
    each = {k: right[k] / n for k, n in sorted(number.items())}
    rates = np.array(list(each.values()))
    drawn = np.random.default_rng(0).choice(rates, (BOOTSTRAPS, len(rates))).mean(axis=1)
    low, high = 100 * np.quantile(drawn, [0.025, 0.975])
    pooled = 100 * sum(right.values()) / sum(number.values())
    worst = ", ".join(f"{k} {right[k]}/{number[k]}" for k in sorted(each, key=each.get)[:WORST])
    return (
        f"{100 * rates.mean():.0f} % ({low:.0f}–{high:.0f} %) of {len(rates)} effects, "
        f"pooled {pooled:.0f} % of {sum(number.values())} cases; lowest: {worst}"
    )


def beside(newest):
    """Figures of the last round beside those of the rival on the same cases."""
    rival = newest["rival"]
    kinds = tuple(ANSWERS), tuple(OUTSIDE)
    print("\n| figure of the last round | the diagnosis | least squares and BIC |\n|---|---|---|")
    for key, (words, _) in (ROWS | {"wrong_and_sure": ("one cause, sure, and wrong: all cases", "")}).items():
        if key in rival and rival[key]["n"] and key != "right_place":
            print(f"| {words} | {together([newest[key]])} | {together([rival[key]])} |")
    cells = []
    for r in (newest, rival):
        number, right = ({k: v[i] for k, v in r["visible_by_effect"].items()} for i in (0, 1))
        cells.append(shares(number, right))
    print(f"| found and in the named set, of effects with signal ≥ 4, counted alike | {' | '.join(cells)} |")
    for words, names in zip(("effects", "kinds outside"), kinds, strict=True):
        cells = " | ".join(macro_average([r], names).split(";")[0] for r in (newest, rival))
        print(f"| right, {words} counted alike | {cells} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--from", type=int, default=3, dest="first", help="round from which on they count together")
    args = parser.parse_args()
    paths = [p for p in args.folder.glob("round*.json") if re.fullmatch(r"round\d+", p.stem)]
    rounds = {int(p.stem.removeprefix("round")): json.loads(p.read_text()) for p in paths}
    every = dict(sorted(rounds.items()))
    newest = every[max(every)]
    rounds = {k: r for k, r in every.items() if r.get("bodies", ["ellipsoid"]) == ["ellipsoid"]}
    for r in [*every.values(), *([newest["rival"]] if "rival" in newest else [])]:
        r["named_and_wrong"] = named_and_wrong(r)
        r["outside_seen"] = outside_seen(r)
    late = [r for k, r in rounds.items() if k >= args.first]
    print("| figure | " + " | ".join(str(k) for k in rounds) + f" | {args.first} to {max(rounds)} (95 %) | goal |")
    print("|---" * (len(rounds) + 3) + "|")
    print(
        "| cases | "
        + " | ".join(str(sum(r["counts"].values())) for r in rounds.values())
        + f" | {sum(sum(r['counts'].values()) for r in late)} | |"
    )
    for key, (words, goal) in ROWS.items():
        cells = [f"{v['k']}/{v['n']}" if (v := r.get(key)) and v["n"] else "–" for r in rounds.values()]
        known = [r[key] for r in late if key in r]
        print(f"| {words} | " + " | ".join(cells) + f" | {together(known)} | {goal} |")
    for key, (words, goal) in PLAIN.items():
        cells = ["–" if r.get(key) is None else f"{r[key]:.2f}".replace("-", "−") for r in rounds.values()]
        print(f"| {words} | " + " | ".join(cells) + f" | | {goal} |")
    kinds = {"effects of the catalogue": tuple(ANSWERS), "kinds outside the catalogue": tuple(OUTSIDE)}
    for words, some in ((f"Rounds {args.first} to {max(rounds)}", late), ("The last round alone", [newest])):
        for kind, names in kinds.items():
            print(f"\n{words}, {kind}, each counted alike: {macro_average(some, names)}.")
    print(f"\nThe last round alone, outside the catalogue, verdict allowed: {together([newest['outside_allowed']])}.")
    if "rival" in newest:
        beside(newest)


if __name__ == "__main__":
    main()
