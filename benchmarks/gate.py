"""Random admissible experiments, none looked at by hand: how many end with an answer, and how the others fail.

    python benchmarks/gate.py [--cases 300 | --only 4,17] [--level coarse] [--first 0] [--out gate.jsonl]

Prints one line per case and, at the end, the share that finished, causes of the others, CPU time and memory.
"""

from __future__ import annotations

import fem_backend  # noqa: F401 - before numpy: it sees to one thread, and waiting threads count as CPU time

# isort: split
import argparse
import json
import multiprocessing
import resource
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np
from fe_errors import effects, log, material

from fem_backend.backend import BACKEND
from rso.contract import Case, Programme, SimulationFailed


def draw(k: int, level: str) -> tuple[dict[str, float], Case]:
    """Values and case number k: law, parameters, point, support, body and depth at random.

    All of them are admissible, a weightless body in a slippery bowl under a ball beside its top too: the energies of
    body, contact and grounding springs are bounded below, so an equilibrium exists.  The body is free to give way, by a
    millimetre or so without any force, until wall and ball face each other across it; that is its answer, and what the
    springs carry meanwhile is stated.  Depths stay below 0.3 of the smallest semi-axis, laws within their own ranges.
    """
    rng = np.random.default_rng([20261121, k])

    values, law = material(rng)
    settings: dict[str, object] = {"material": {"law": law}, "mesh": {"level": level}}
    where = rng.random()
    if where < 0.4:
        settings["point"] = [0.0, 0.0]
    elif where < 0.7:
        settings["point"] = [[round(rng.uniform(-25, 25), 1), 0.0], [0.0, round(rng.uniform(-15, 15), 1)]][
            rng.integers(2)
        ]
    else:
        r, t = 0.5 * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
        settings["point"] = [float(round(60 * r * np.cos(t), 1)), float(round(35 * r * np.sin(t), 1))]
    settings["direction"] = str(rng.choice(["vertical", "normal"]))
    settings["indenter"] = {"radius": 3.0, "shaft": bool(rng.random() < 0.5)}
    if rng.random() < 0.35:
        settings["support"] = {
            "kind": "bowl",
            "clearance": log(rng, 0.2, 4.0),
            "friction": float(rng.choice([0.0, 0.2, 0.5])),
        }
    extras = effects(rng, values["mu"], askew=True)
    for i in rng.permutation(len(extras))[: rng.choice([0, 1, 1, 2])]:
        values |= {n: float(v) for n, v in extras[i].items()}
    deepest = round(rng.uniform(1.0, 6.0), 2)
    asked = tuple(round(deepest * f, 4) for f in (0.25, 0.5, 0.75, 1.0))
    speed = log(rng, 0.1, 2.0)
    if rng.random() < 0.3:
        programme = Programme((0, deepest / speed, 2 * deepest / speed), (0, deepest, 0), asked)
    else:
        programme = Programme.ramp(asked, speed)
    return values, Case(f"case {k}", programme, settings)


def run(k: int, level: str) -> dict[str, object]:
    """One case: its end, forces, CPU time (s) and peak memory of this process (MB)."""
    values, case = draw(k, level)
    started = time.process_time()
    out: dict[str, object] = {"case": k, "values": values, "settings": dict(case.settings)}
    try:
        response = BACKEND(values, case)
        kept = ("iterations", "cutbacks", "loose", "dofs", "spring_share")
        out |= {"end": "done", "Fz": response.channels["Fz"].tolist(), **{n: response.info.get(n) for n in kept}}
    except SimulationFailed as failed:
        out |= {"end": failed.cause, "reason": failed.reason}
    except Exception as error:  # a crash is what this script is looking for
        out |= {"end": "CRASHED", "reason": f"{type(error).__name__}: {error}"}
    out["cpu_s"] = round(time.process_time() - started, 2)
    out["memory_MB"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    return out


def apart(k: int, level: str) -> dict[str, object]:
    """One case in a process of its own, so that its memory is its own and a crash of a library is seen."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool:
        try:
            return pool.submit(run, k, level).result()
        except BrokenProcessPool:
            return {"case": k, "end": "CRASHED", "reason": "the process died", "cpu_s": 0.0, "memory_MB": 0}


def main() -> None:
    """Run the cases that are not yet in the file and print the summary of all that are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", default="", help="case numbers with commas instead")
    parser.add_argument("--level", default="coarse")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    known = (
        [json.loads(line) for line in options.out.read_text().splitlines()]
        if options.out and options.out.exists()
        else []
    )
    done = {r["case"] for r in known}
    wanted = [int(k) for k in options.only.split(",") if k] or range(options.first, options.first + options.cases)
    for k in wanted:
        if k in done:
            continue
        known.append(apart(k, options.level))
        if options.out:
            with options.out.open("a") as file:
                file.write(json.dumps(known[-1]) + "\n")
        print(f"{k:4d} {known[-1]['end']:14s} {known[-1]['cpu_s']:7.1f} s  {known[-1].get('reason', '')}", flush=True)
    ends = Counter(str(r["end"]) for r in known)
    cpu = np.array([r["cpu_s"] for r in known])
    print(f"{ends['done']} of {len(known)} finished ({100 * ends['done'] / len(known):.1f} %); {dict(ends)}")
    print(
        f"CPU s: median {np.median(cpu):.1f}, 90 % {np.quantile(cpu, 0.9):.1f}, largest {cpu.max():.1f}; "
        f"memory at most {max(r['memory_MB'] for r in known)} MB, "
        f"above 500 MB in {sum(r['memory_MB'] > 500 for r in known)}"
    )


if __name__ == "__main__":
    main()
