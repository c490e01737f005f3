"""Make synthetic experiments whose effect is withheld.

python benchmarks/blind/generate.py --out DIR --null 30 --single 40 --pair 10 --outside 10
    adds that many cases to what DIR is already asked to hold and makes what is missing; run again with zeros to resume.
DIR/case_0001/ holds CSVs and nominal.json; DIR/sealed/ the truths; DIR/hashes.txt the SHA-256 of each sealed file,
written when the case is made. A sealed file holds a random salt, so its hash cannot be guessed from a list of effects.
Cases that need no finite elements are made first, then the single effects; numbers are drawn at random, so that they
say nothing.
"""

import argparse
import hashlib
import json
import os
import secrets
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import catalogue
import experiment
import flat
import library
import numpy as np

NOMINAL = {
    "family": "A",
    "support": "fixed: lower half surface (z<0) bonded to the holder",
    "units": "N, mm, MPa, s",
    "specimen": {"shape": "ellipsoid", "semi_axes_mm": [60, 35, 35]},
    "indenter": {
        "shape": "sphere",
        "radius_mm": 3.0,
        "rigid": True,
        "full_sphere": True,
        "direction": [0, 0, -1],
        "friction": 0.0,
    },
    "frame": "x along the major axis, z up, origin at the specimen centre; MP = (0,0,35)",
    "depth": "indenter travel since first contact",
    "force": "force of the specimen on the indenter, Fz>0 pushes it up",
    "rate_mm_per_min": 30,
    "cycle_rates_mm_per_min": [10, 30, 100],
    "rest_between_tests": "long (full recovery assumed)",
    "order_of_tests": "mp_load repeats 1-5, mp_cycle 10, 30, 100, mp_deep, points, "
    "profile (recorded with the first mp_load repeat)",
    "points_mm": [[2.5, 2.5], [20, 0]],
    "profile": "vertical displacement of surface marks at reference y=5 mm since contact",
}
NOISE = {  # (from, to) of each case, log-uniform, and whether the laboratory knows it; since the twenty-second round
    "force_N": (0.7e-3, 9e-3, True),
    "depth_mm": (1e-3, 1.2e-2, True),
    "repeat_gain": (2e-3, 2.5e-2, True),
    "profile_mm": (0.02, 0.12, True),
    "jitter_mm": (3e-3, 3e-2, False),
}
LOOK_ALIKE = {"fibre_x", "fibre_y", "skin_stiff", "skin_soft", "inclusion_stiff", "inclusion_soft", "cavity"}


def draw_names(kind, count, rng, drawn, body="ellipsoid"):
    """Names of the effects of `count` cases of one kind; rarely drawn ones first."""
    if kind == "null":
        return [[] for _ in range(count)]
    single, outside = (
        (flat.single(body), flat.outside()) if body in flat.BODIES else (catalogue.SINGLE, tuple(catalogue.OUTSIDE))
    )
    if kind == "outside":
        return [[n] for n in balanced(list(outside), count, rng, drawn)]
    if kind == "single":
        return [[n] for n in balanced(list(single), count, rng, drawn)]
    pairs = []
    while len(pairs) < count:
        a, b = rng.choice(list(single), 2, replace=False)
        clash = {a, b} <= LOOK_ALIKE or ("mullins" in (a, b) and not {a, b} & set(catalogue.FREE))
        if not clash and not (a[:6] == b[:6]):
            pairs.append([str(a), str(b)])
    return pairs


def balanced(names, count, rng, drawn):
    """`count` names, those with the fewest cases so far first, in random order among equals."""
    out = []
    for _ in range(count):
        few = min(drawn.get(n, 0) for n in names)
        name = str(rng.choice([n for n in names if drawn.get(n, 0) == few]))
        drawn[name] = drawn.get(name, 0) + 1
        out.append(name)
    return out


def draw_case(kind, names, rng, body="ellipsoid"):
    """Everything random of one case, JSON-able."""
    mu, D1 = catalogue.log_uniform(rng, 5e-3, 16e-3), catalogue.log_uniform(rng, 2.0, 80.0)
    rho = float(rng.uniform(0.3, 0.85)) if rng.uniform() < 0.35 else 0.0
    effects = [flat.draw(n, rng, body) if body in flat.BODIES else catalogue.draw(n, rng) for n in names]
    noise = {k: catalogue.log_uniform(rng, low, high) for k, (low, high, _) in NOISE.items()}
    case = {"kind": kind, "mu": mu, "D1": D1, "rho": rho, "noise": noise, "effects": effects}
    case |= {} if body == "ellipsoid" else {"body": body}
    return {**case, "noise_seed": secrets.randbits(96)}


def extend_plan(out, counts, body="ellipsoid"):
    """Read the sealed plan of DIR, add what `counts` asks for, write it back."""
    path = out / "sealed" / "plan.json"
    plan = json.loads(path.read_text()) if path.exists() else []
    rng = np.random.default_rng(secrets.randbits(128))  # the one place where the operating system's entropy is right
    drawn = {}
    for case in plan:
        for effect in case["effects"]:
            drawn[effect["name"]] = drawn.get(effect["name"], 0) + (case["kind"] != "pair")
    new = [
        draw_case(kind, names, rng, body)
        for kind, n in counts.items()
        for names in draw_names(kind, n, rng, drawn, body)
    ]
    for rank, case in zip(rng.permutation(len(new)), new, strict=True):
        case["id"] = f"case_{len(plan) + rank + 1:04d}"
    plan += new
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, plan)
    return plan


def write_json(path, content):
    """Write a file as a whole or not at all."""
    tmp = path.with_suffix(".tmp")
    tmp.write_text(json.dumps(content, indent=1) + "\n")
    os.replace(tmp, path)


def mechanics(case):
    """Model changes of a case -> Mechanics (with finite elements where needed) and the FE facts for the truth."""
    changes = {}
    for effect in case["effects"]:
        changes.update(effect["model"])
    mu, muD1 = case["mu"], case["mu"] * case["D1"]
    if "body" in case:
        for name in ("adhesion", "weight"):
            if f"{name}_mpa" in changes:
                changes[name] = changes.pop(f"{name}_mpa") / mu
        if "foundation_mpa" in changes:
            changes["foundation"] = changes.pop("foundation_mpa") * mu
        tables, facts = flat.tables(case["body"], muD1, changes) if changes else ({}, {})
        return flat.Mechanics(case["body"], muD1, tables), facts
    moved = displaced(case)
    if not changes and not moved:
        return experiment.Mechanics(muD1), {}
    import solve

    for name in ("adhesion", "weight"):
        if f"{name}_mpa" in changes:
            changes[name] = changes.pop(f"{name}_mpa") / mu
    tables, facts = solve.tables(muD1, changes) if changes else ({}, {})
    turned = {}
    if moved:
        offset, tilt = ([moved.get(f"{name}_{k}", 0.0) for k in "xy"] for name in ("offset", "tilt"))
        turned = solve.turned(muD1, offset, np.radians(tilt))
        facts = {"deepest": min(turned["top"]["deepest"], facts.get("deepest", np.inf))}
    return experiment.Mechanics(muD1, tables, "adhesion" in changes, turned), facts


def displaced(case):
    """Misalignment (mm) and tilt (degrees) of a case, {name: size}."""
    return {k: v for e in case["effects"] for k, v in e["chain"].items() if k in catalogue.TURNED}


def make(case, out):
    """Make one case: files and sealed truth, whose hash is returned."""
    t0 = time.process_time()
    mech, facts = mechanics(case)
    chain = {}
    for effect in case["effects"]:
        chain.update(effect["chain"])
    noise = {**case["noise"], "rho": case["rho"]}
    stated = {k: float(f"{noise[k]:.1g}") for k, (*_, known) in NOISE.items() if known}  # as a data sheet says it
    rng = np.random.default_rng(case["noise_seed"])
    body = case.get("body")
    ran = [t[0] for t in (flat if body else experiment).plan()].index("mp_deep")
    shift = chain.get("offset", 0.0) + chain.get("offsets", np.zeros(12))[ran]  # its depth starts this much too late
    if body:
        deep = min(flat.DEEP, facts.get("deepest", np.inf) - max(0.0, shift))
        records = flat.clean(mech, case["mu"], chain, deep)
        flat.write(out / case["id"], records, chain, rng, noise, flat.nominal(body, stated))
        size, where = experiment.signal(records, case["D1"], case["mu"], noise, flat.Mechanics.unmodified(body))
    else:
        deep = min(experiment.DEEP, facts.get("deepest", library.DEEPEST) - max(0.0, shift))
        nominal = {**NOMINAL, "noise": stated}
        records = experiment.write(out / case["id"], mech, case["mu"], chain, rng, noise, nominal, deep)
        size, where = experiment.signal(records, case["D1"], case["mu"], noise)
    at = np.array([0.5, 1.0, 1.5, 2.0] if body else [1.0, 2.0, 3.0, 4.0])
    top = mech.force("mp_load", 1, "top", "load", at)[:, 2] * case["mu"]
    truth = {
        "salt": secrets.token_hex(32),
        "id": case["id"],
        "kind": case["kind"],
        "effects": [{k: e[k] for k in ("name", "size", "truth")} for e in case["effects"]],
        "material": {"mu": case["mu"], "D1": case["D1"]},
        "noise": noise,
        "signal": size,
        "where": where,
        "allowed": allowed(case, size),
        "force_without_noise_N": dict(zip([f"{d:g}" for d in at], np.round(top, 6).tolist(), strict=True)),
        **({"body": body} if body else {}),
        "fe": facts,
        "redrawn": case.get("redrawn", 0),
        "cpu_s": round(time.process_time() - t0, 1),
    }
    path = out / "sealed" / f"{case['id']}.json"
    write_json(path, truth)
    return hashlib.sha256(path.read_bytes()).hexdigest()


def publish(out, name, digest):
    """Add the hash of a sealed truth to the list."""
    listed = out / "hashes.txt"  # kept in the order of the numbers: that of the making would say what took long
    lines = [*(listed.read_text().splitlines() if listed.exists() else []), f"{name}  {digest}"]
    new = listed.with_suffix(".tmp")
    new.write_text("\n".join(sorted(lines)) + "\n")
    os.replace(new, listed)


def make_somehow(case, out, attempts=3):
    """Make a case; when its mechanics fail, with sizes and material drawn again -> the case, its hash or None, why."""
    why = []
    for attempt in range(attempts):
        try:
            return case, make(case, out), why
        except Exception as error:
            why.append(type(error).__name__)
            names = [e["name"] for e in case["effects"]]
            rng = np.random.default_rng(secrets.randbits(128))
            again = draw_case(case["kind"], names, rng, case.get("body", "ellipsoid"))
            case = {**case, **again, "redrawn": attempt + 1}
    return case, None, why


def allowed(case, size, visible=4.0):
    """Verdicts that count as right, and the causes with which 'explained' is right."""
    if case["kind"] == "null":
        return {"verdicts": ["no_gap"], "causes": []}
    if case["kind"] == "outside":
        verdicts, causes = catalogue.OUTSIDE[case["effects"][0]["name"]]
        known = catalogue.LISTED | (flat.LISTED if "body" in case else {})
        listed = list(known.get(case["effects"][0]["name"], ()))
        verdicts, causes = list(verdicts), [*causes, *(c for c in listed if c not in causes)]
    else:
        names = [e["name"] for e in case["effects"]]
        causes = sorted(set().union(*((catalogue.ANSWERS | flat.ANSWERS)[n] for n in names)))
        verdicts = (
            ["explained", "ambiguous", "partly"]
            if case["kind"] == "single"
            else ["explained", "ambiguous", "partly", "unexplained"]
        )
        if set(names) & set(catalogue.CHAIN):
            verdicts.append("measurement")
    if size < visible:
        verdicts.append("no_gap")
    return {"verdicts": verdicts, "causes": causes, **({"listed": listed} if case["kind"] == "outside" else {})}


def cost(case):
    """0 without finite elements, more for histories (friction: the dearest) and misalignment or tilt."""
    model = {k for e in case["effects"] for k in e["model"]}
    return bool(model) + ("prony" in model) + 2 * ("friction" in model) + 2 * bool(displaced(case))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    for kind in ("null", "single", "pair", "outside"):
        parser.add_argument(f"--{kind}", type=int, default=0)
    parser.add_argument("--body", choices=("ellipsoid", *flat.BODIES), default="ellipsoid", help="of the new cases")
    parser.add_argument("--free-only", action="store_true", help="leave cases that need finite elements for later")
    parser.add_argument("--first", nargs="*", default=[], help="effects whose cases are made first (drawn as ever)")
    parser.add_argument("--jobs", type=int, default=1, help="cases made at the same time")
    args = parser.parse_args()
    plan = extend_plan(args.out, {k: getattr(args, k) for k in ("null", "single", "pair", "outside")}, args.body)
    listed = (args.out / "hashes.txt").read_text() if (args.out / "hashes.txt").exists() else ""
    for case in plan:  # sealed, but the run ended before its hash was published
        path = args.out / "sealed" / f"{case['id']}.json"
        if path.exists() and case["id"] not in listed:
            publish(args.out, case["id"], hashlib.sha256(path.read_bytes()).hexdigest())
    todo = [c for c in plan if not (args.out / "sealed" / f"{c['id']}.json").exists()]

    def turn(case):
        late = not any(e["name"] in args.first for e in case["effects"])
        return cost(case) > 0, case["kind"] != "single", late, cost(case)

    todo = [c for c in sorted(todo, key=turn) if not (args.free_only and cost(c))]
    made = failed = 0
    with ProcessPoolExecutor(args.jobs) as pool:
        for done in as_completed([pool.submit(make_somehow, c, args.out) for c in todo]):
            case, digest, why = done.result()
            failed += len(why)
            made += digest is not None
            if why:
                plan[[c["id"] for c in plan].index(case["id"])] = case
                write_json(args.out / "sealed" / "plan.json", plan)
            if digest:
                publish(args.out, case["id"], digest)
            print(f"{made} of {len(todo)} made, {failed} draws failed {' '.join(why)}".rstrip(), flush=True)


if __name__ == "__main__":
    main()
