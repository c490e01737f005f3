"""Whether runs on a meridian end well: random experiments of revolution: `python meridian_gate.py [--cases N]`.

    --cases N       how many (300)
    --first K       the first of them
    --balls         only balls on bonded slabs to 1.5 R, as before, 20 depths
    --remesh HOW    when_needed or never; the default of the settings without

Slabs, pucks, spheres and half-spaces; balls with and without a shaft, flat ends, cones; bonded, sliding on a plate, in
a well, held, in a bowl; four laws, some that relax or soften; K/μ from 1.2 to 10⁴; down to 2.5 lengths of the indenter
or 0.7 of the thickness; levels coarse and standard.  A case that is refused in words before it runs is drawn again.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from fem_backend.backend import BACKEND
from fem_backend.simulation import assembly, indentation
from fem_backend.simulation.experiment import Settings, read_settings
from fem_backend.simulation.knobs import Knobs
from fem_backend.solver.load_steps import Instant, Stopped

R, MU, SEED = 3.0, 0.01, 43
DEPTHS = 6  # asked of each case
LAWS: dict[str, Mapping[str, Any]] = {
    "neo_hookean": {},
    "mooney_rivlin": {"C01": 0.002},
    "yeoh": {"C20": 0.001, "C30": 0.0002},
    "ogden": {"alpha": 4.0},
}


def case(thickness: float, ratio: float, law: str, level: str, solver: str = "auto") -> tuple[Any, ...]:
    """Settings, knobs, placement and model of a bonded slab under a ball; lengths in mm."""
    settings = read_settings(
        {
            "specimen": {"shape": "slab", "thickness": thickness},
            "indenter": {"shape": "sphere", "radius": R, "shaft": True},
            "support": {"kind": "bonded"},
            "material": {"law": law},
            "mesh": {"level": level},
            "solver": solver,
        }
    )
    knobs = Knobs(mu=MU, D1=2.0 / (ratio * MU), **LAWS[law])
    placement = assembly.placement_of(settings, knobs)
    return settings, knobs, placement, assembly.model_for(settings, knobs, placement, None)


def specimen(rng: np.random.Generator) -> tuple[dict[str, Any], float, tuple[str, ...]]:
    """A specimen, its thickness (mm) and the supports that it may have."""
    kind = rng.integers(4)
    H = R * float(np.exp(rng.uniform(np.log(0.7), np.log(8.0))))
    if kind == 0:
        return {"shape": "slab", "thickness": H}, H, ("bonded", "plate")
    if kind == 1:
        wide = R * float(rng.uniform(2.0, 5.0))
        return {"shape": "cylinder", "radius": wide, "height": H, "fillet": 0.1 * H}, H, ("bonded", "plate", "well")
    if kind == 2:
        radius = R * float(rng.uniform(6.0, 14.0))
        return {"shape": "sphere", "radius": radius}, 2.0 * radius, ("fixed", "bowl")
    return {"shape": "half_space"}, np.inf, ("bonded",)


def indenter(rng: np.random.Generator) -> dict[str, Any]:
    """A ball, a flat end or a cone, about as large as R."""
    kind = rng.integers(4)
    if kind < 2:
        return {"shape": "sphere", "radius": R, "shaft": bool(kind)}
    if kind == 2:
        return {"shape": "flat", "radius": R, "fillet": R * float(rng.uniform(0.05, 0.3))}
    return {
        "shape": "cone",
        "half_angle": float(rng.uniform(45.0, 75.0)),
        "tip_radius": R * float(rng.uniform(0.05, 0.3)),
    }


def drawn(rng: np.random.Generator, level: str, remesh: str | None) -> tuple[str, Settings, dict[str, float], float]:
    """A random experiment in words, its settings and values, and its depth (mm)."""
    body, thickness, supports = specimen(rng)
    tip, law = indenter(rng), list(LAWS)[rng.integers(4)]
    support: dict[str, Any] = {"kind": supports[rng.integers(len(supports))]}
    if support["kind"] == "bowl":
        support |= {"clearance": float(rng.uniform(0.3, 2.0)), "friction": 0.0}
    if support["kind"] == "well":
        support |= {"radius": body["radius"] + float(rng.uniform(0.0, 0.3)), "wall": "gap"}
    ratio = float(np.exp(rng.uniform(np.log(1.2), np.log(1e4))))
    knobs = {"mu": MU, "D1": 2.0 / (ratio * MU), **LAWS[law]}
    memory = rng.integers(6)
    knobs |= (
        {"prony_g": 0.4, "prony_tau": 2.0} if memory == 0 else {"mullins": 0.5, "mullins_m": 0.5} if memory == 1 else {}
    )
    mesh = {"level": level} | ({"remesh": remesh} if remesh else {})
    table = {"specimen": body, "indenter": tip, "support": support, "material": {"law": law}, "mesh": mesh}
    depth = min(float(rng.uniform(1.0, 2.5)) * R, float(rng.uniform(0.3, 0.7)) * thickness)
    words = (
        f"{body['shape']:10s} H/R {thickness / R:5.2f} {support['kind']:6s} {tip['shape']:6s} {law:13s} "
        f"K/mu {ratio:7.1f} {('relaxes', 'softens')[memory] if memory < 2 else '':7s} {level:8s} {depth / R:4.2f} R"
    )
    return words, read_settings({**table, "derivatives": False}), knobs, depth


def tried(settings: Settings, values: Mapping[str, float], depth: float) -> tuple[str, float, float]:
    """How a run ends, how far it comes (share of its depth), and CPU s."""
    knobs = BACKEND.knobs(values, settings)
    placement = assembly.placement_of(settings, knobs)
    model = assembly.model_for(settings, knobs, placement, None)
    started = time.process_time()
    instants = [Instant(float(d), float(d), True) for d in np.linspace(depth / DEPTHS, depth, DEPTHS)]
    try:
        result = indentation.simulate_indentation(settings, knobs, placement, model, instants)
        lost = indentation.doubtful(result)
        end = ("done", 1.0) if lost is None else (lost[1], lost[0] / DEPTHS)
    except Stopped as stopped:
        end = (stopped.cause, max((p.travel for p in stopped.points), default=0.0) / depth)
    return *end, time.process_time() - started


def all_kinds(count: int, first: int, remesh: str | None) -> None:
    """Print a line a case, how many ended well, and failures by cause."""
    ends: Counter[str] = Counter()
    spent: list[float] = []
    for k in range(first, first + count):
        rng = np.random.default_rng((SEED, k))
        while True:
            try:
                words, settings, values, depth = drawn(rng, ("coarse", "standard")[k % 2], remesh)
                end, share, cpu = tried(settings, values, depth)
            except ValueError as refusal:
                ends["refused beforehand"] += 1
                print(f"{k:3d} refused: {str(refusal)[:100]}", flush=True)
                continue
            break
        ends[end] += 1
        spent.append(cpu)
        print(f"{k:3d} {words} {cpu:6.2f} s  {end}" + ("" if end == "done" else f", {100.0 * share:.0f} %"), flush=True)
    print(", ".join(f"{n} {end}" for end, n in ends.most_common()))
    print(f"{ends['done']} of {count} ended well; CPU s: median {np.median(spent):.2f}, most {max(spent):.2f}")


def balls(count: int) -> None:
    """Balls on bonded slabs: a line a case and how many ended well."""
    rng, done, spent = np.random.default_rng(SEED), 0, []
    for k in range(count):
        thickness = R * float(np.exp(rng.uniform(np.log(0.5), np.log(10.0))))
        ratio = float(np.exp(rng.uniform(np.log(2.0), np.log(1e4))))
        law, level = list(LAWS)[rng.integers(4)], ("coarse", "standard")[rng.integers(2)]
        deepest = min(1.5 * R, 0.7 * thickness)
        words = f"{k:3d} H/R {thickness / R:5.2f} K/mu {ratio:7.0f} {law:13s} {level:8s}"
        started = time.process_time()
        try:
            ready = case(thickness, ratio, law, level)
            started = time.process_time()
            instants = [Instant(d, d, True) for d in np.linspace(deepest / 20, deepest, 20)]
            found = indentation.simulate_indentation(*ready, instants)
        except (Stopped, ValueError) as error:
            print(f"{words} {time.process_time() - started:6.2f} s  {error}", flush=True)
            continue
        done += 1
        spent.append(time.process_time() - started)
        c = found.counters
        print(
            f"{words} {spent[-1]:6.2f} s  {c.factorisations} factorisations, {c.iterations} iterations, "
            f"{c.shifts} shifts, {c.cutbacks} cut, {c.fallbacks} plain",
            flush=True,
        )
    print(f"{done} of {count} ended well; CPU s: median {np.median(spent):.2f}, most {max(spent):.2f}")


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--balls", action="store_true")
    parser.add_argument("--remesh", choices=("when_needed", "never"))
    options = parser.parse_args()
    if options.balls:
        balls(options.cases)
    else:
        all_kinds(options.cases, options.first, options.remesh)


if __name__ == "__main__":
    main()
