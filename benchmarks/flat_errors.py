"""Do stated errors cover true ones on flat bodies in space?  `python flat_errors.py [--draws 40] [--out FILE] …`

    --draws N       random experiments that calibration.toml is fitted to (36)
    --more N        others that it is fitted to, after the forms were chosen by the first (24)
    --fresh N       others, kept back (14)
    --effects N     blocks with fibres, an inclusion, a cavity, what relaxes or softens, in turn (0)
    --dear N        of each, the first N runs also on the levels fine and reference, where they have a meridian (0)
    --out FILE      keeps the runs: a second call only prints

Balls on blocks, pucks and slabs: 0.002 to 1.3 R deep, 0.7 to 6 R thick, K/μ from 1.2 to 200, five laws, layers and
skins, friction, bonded or on a plate.  Two in five are tests of revolution that are solved in space all the same,
beside the meridian at the level reference.  Others are blocks at the middle, bodies pressed beside it, and tilted ones:
beside elements of no size, c of what coarse, standard and fine have, f = c + e h² with the size h, by least squares.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import numpy as np
from fe_errors import LABELS, QUANTILE, log, material, pinball

from fem_backend.accuracy import error_estimate
from fem_backend.backend import BACKEND
from fem_backend.meshing.grids import GRID_SIZE_FACTORS
from fem_backend.simulation import assembly, contact_elements, experiment
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.indentation import Result
from fem_backend.simulation.knobs import Knobs
from fem_backend.solver.newton import Counters
from rso.contract import Case, Programme, SimulationFailed

R = 3.0
FIT, MORE, EFFECTS, FRESH = 1, 2, 3, 4  # seeds
LEVELS = ("coarse", "standard")
TWIN, MIDDLE, BESIDE, TILTED = "twin", "middle", "beside", "tilted"
WHAT = (TWIN, MIDDLE, TWIN, BESIDE, TWIN, MIDDLE, TWIN, TILTED, TWIN, MIDDLE)  # of the experiments one after the other
ASKED = (0.06, 0.25, 0.5, 0.75, 1.0)  # of the deepest travel


@dataclasses.dataclass(frozen=True)
class Draw:
    """One experiment: knobs, settings without the mesh, depth (mm), and whether its meridian could be modelled."""

    values: dict[str, float]
    settings: dict[str, Any]
    depth: float
    twin: bool

    def case(self, level: str) -> tuple[dict[str, float], Case]:
        """Canonical values and case at a level."""
        programme = Programme.ramp(tuple(round(self.depth * f, 6) for f in ASKED), R)
        case = Case("flat", programme, {**self.settings, "mesh": {"level": level}, "derivatives": False})
        return BACKEND.canonical(self.values, case)


def support(rng: np.random.Generator, rubs: bool) -> dict[str, Any]:
    """Half of them bonded; every fourth of those that may rub lies on a rough plate."""
    found = [
        {"kind": "bonded"},
        {"kind": "bonded"},
        {"kind": "plate", "friction": 0.0},
        {"kind": "plate", "friction": 0.0},
        {"kind": "plate", "friction": float(rng.uniform(0.05, 0.8)), "lift": bool(rng.random() < 0.3)},
    ]
    return found[rng.integers(4 if rubs else 3)]


def kind_of(seed: int, k: int) -> str:
    """What kind of experiment number k is."""
    return MIDDLE if seed == EFFECTS else WHAT[k % len(WHAT)]


def effect(rng: np.random.Generator, k: int, mu: float, H: float) -> dict[str, float]:
    """Knobs of what the other experiments leave out, on a body of a height (mm)."""
    found: list[dict[str, float]] = [
        {"fibre": mu * rng.uniform(0.1, 1.0)},
        {"inclusion_ratio": log(rng, 0.2, 10.0), "inclusion_radius": 0.3 * H, "inclusion_depth": 0.5 * H},
        {"cavity": rng.uniform(0.5, 1.0)},
        {"prony_g": rng.uniform(0.05, 0.6), "prony_tau": log(rng, 0.3, 60.0)},
        {"mullins": rng.uniform(0.05, 0.5)},
    ]
    return {name: float(v) for name, v in found[k % len(found)].items()}


def draw(seed: int, k: int) -> Draw:
    """Experiment number k; half models, which cost ten times as much, are less thick and not hardly pressed."""
    rng = np.random.default_rng([20261128, seed, k])
    values, law = material(rng, 1.2, 0.7)
    what, point, body = kind_of(seed, k), [0.0, 0.0], {}
    half = what in (BESIDE, TILTED)
    H = R * log(rng, 0.7, 3.0 if half else 6.0)
    depth = R * (log(rng, 0.03 if half else 0.002, 0.3) if rng.random() < 0.5 else rng.uniform(0.1, 1.3))
    depth = min(depth, 0.5 * H)
    a = float(min(np.sqrt(R * depth), R))
    wide = max(R * log(rng, 1.2, 8.0), 1.5 * float(a))
    if rng.random() < (0.3 if what == TWIN else 0.08):
        values["friction"] = float(rng.uniform(0.05, 0.8))
    room = wide - 1.3 * a
    if what == TWIN:
        puck = {"shape": "cylinder", "radius": wide, "height": H}
        body = puck if rng.random() < 0.5 else {"shape": "slab", "thickness": H}
    elif what == MIDDLE or (what == BESIDE and rng.random() < 0.6):
        body = {"shape": "block", "size": [2.0 * wide, 2.0 * wide * float(rng.uniform(1.0, 2.0)), H]}
    elif what == BESIDE:
        body = {"shape": "cylinder", "radius": wide, "height": H}
    else:
        body = [
            {"shape": "slab", "thickness": H},
            {"shape": "block", "size": [2.0 * wide, 2.0 * wide, H]},
            {"shape": "cylinder", "radius": wide, "height": H},
        ][rng.integers(3)]
        values["tilt_y"] = float(rng.uniform(0.5, 8.0))
    if what == BESIDE:
        point = [round(float(rng.uniform(0.1, 0.9)) * room, 3), 0.0]
    if rng.random() < 0.3:
        parts = rng.dirichlet([1.0, 1.0, 2.0])[: rng.integers(1, 3)]
        body["layers"] = [{"thickness": max(float(p), 0.03) * H, "ratio": log(rng, 0.05, 20.0)} for p in parts]
    if rng.random() < 0.2:
        values["skin_ratio"] = log(rng, 0.3, 5.0)
        values["skin_thickness"] = 0.45 * min(H, wide) * float(rng.uniform(0.1, 1.0))
    if seed == EFFECTS:
        values |= effect(rng, k, values["mu"], H)
    profile = []
    for low, high in ((0.0, a), (a, 3.0 * a), (3.0 * a, 8.0 * R)):
        r, t = rng.uniform(low, high), rng.uniform(0, np.pi / 2)
        x, y = point[0] + r * np.cos(t), point[1] + r * np.sin(t)
        if np.hypot(x, y) < 0.95 * wide:
            profile.append([round(float(x), 3), round(float(y), 3)])
    settings = {
        "specimen": body,
        "material": {"law": law},
        "point": point,
        "indenter": {"shape": "sphere", "radius": R},
        "support": support(rng, not half),
        "profile": profile,
    }
    return Draw(values, settings, depth, what == TWIN)


@dataclasses.dataclass(frozen=True)
class Compared:
    """A run, its mean edge below the ball over h₀, and the true error (k,) of each of its channels."""

    seed: int
    k: int
    settings: Settings
    knobs: Knobs
    result: Result
    edge: float
    true: dict[str, np.ndarray]


Runs = Mapping[tuple[int, int, str], Mapping[str, Any]]


@contextlib.contextmanager
def in_space() -> Iterator[None]:
    """A test of revolution is solved as any other."""
    placed = assembly.placement_of
    with mock.patch.object(
        assembly, "placement_of", lambda *given: dataclasses.replace(placed(*given), meridian=False)
    ):
        yield


def run(seed: int, k: int, level: str) -> dict[str, Any]:
    """One run as plain data; the level "meridian" is that of reference on the meridian."""
    one, started = draw(seed, k), time.process_time()
    out: dict[str, Any] = {"seed": seed, "k": k, "level": level}
    try:
        values, case = one.case("reference" if level == "meridian" else level)
        with contextlib.nullcontext() if level == "meridian" else in_space():
            solved = BACKEND.solve(values, case)
            result = solved.result
            reach = error_estimate.unreached(solved.settings, solved.knobs, result)
            out["edge"] = reach**0.5 * error_estimate.calibration_of_run(solved.settings, solved.knobs).mean_edge
        out["channels"] = {n: v.tolist() for n, v in result.channels.items()}
        out["contact_error"], out["residual"] = result.contact_error.tolist(), result.residual.tolist()
    except (ArithmeticError, ValueError, SimulationFailed) as error:
        out["failed"] = f"{type(error).__name__}: {error}"[:300]
    return out | {"cpu": time.process_time() - started}


def of_no_size(at: Mapping[str, np.ndarray]) -> np.ndarray:
    """c (k,) of c + e h² by least squares through values (k,) at several levels."""
    h = np.array([GRID_SIZE_FACTORS[level] for level in at])
    return np.linalg.lstsq(np.column_stack([np.ones(len(h)), h**2]), np.stack(list(at.values())), rcond=None)[0][0]


def compared(runs: Runs, seed: int) -> Iterator[Compared]:
    """Every run of a seed that can be compared with the truth."""
    for (s, k, level), found in runs.items():
        one = draw(s, k)
        levels = [lv for lv in GRID_SIZE_FACTORS if "channels" in runs.get((s, k, lv), {})]
        best = runs.get((s, k, "meridian"), {}).get("channels")
        if s != seed or level == "meridian" or "channels" not in found or (len(levels) < 3 if best is None else False):
            continue
        true = {}
        for name, v in found["channels"].items():
            if best is not None:
                limit = np.array(best[name])
            elif name == "uz_max" and not {"tilt_y", "skin_ratio"} & set(one.values):  # the ball's lowest point touches
                limit = np.array(found["channels"]["travel"])
            else:
                limit = of_no_size({lv: np.array(runs[s, k, lv]["channels"][name]) for lv in levels})
            true[name] = np.abs(np.array(v) - limit)
        values, case = one.case(level)
        settings = meshed(values, case)
        channels = {n: np.array(v) for n, v in found["channels"].items()}
        change, left = np.array(found["contact_error"]), np.array(found["residual"])
        result = Result(channels, np.zeros((len(change), 3)), change, left, Counters(), found["cpu"])
        yield Compared(s, k, settings, BACKEND.knobs(values, settings), result, found["edge"], true)


def meshed(values: Mapping[str, float], case: Case) -> Settings:
    """The settings of a run, with the grid for its depth."""
    return contact_elements.shallow_in_space(experiment.read_settings(case.settings), max(case.programme.travel_mm))


@contextlib.contextmanager
def of(c: Compared) -> Iterator[None]:
    """What is stated is that of this run, whose mesh is not kept."""
    reach = max(1.0, (c.edge / error_estimate.calibration_of_run(c.settings, c.knobs).mean_edge) ** 2)
    with in_space(), mock.patch.object(error_estimate, "unreached", lambda *_: reach):
        yield


def fit(every: Sequence[Compared]) -> None:
    """Shares of every kind of channel by quantile regression, as `fe_errors.calibrate` has them."""
    rows: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for c in every:
        with of(c):
            other = error_estimate.run_terms(c.settings, c.knobs, c.result)
            columns = error_estimate.columns(c.settings, c.knobs, c.result)
            slopes = error_estimate.aslant(c.settings, c.knobs, c.result)
            own = error_estimate.calibration_of_run(c.settings, c.knobs).shares["force"]
        for name, parts in columns.items():
            if name not in ("Fx", "Fy"):
                rest = np.maximum(c.true[name] - other.get(name, 0.0), 0.0)
                rows.setdefault(error_estimate.calibration_kind(name), []).append((parts, rest))
        for name, parts in slopes.items():
            left = columns[name] @ np.array(own) + other[name]
            rows.setdefault("lateral", []).append((parts, np.sqrt(np.maximum(c.true[name] ** 2 - left**2, 0.0))))
    print(f"shares, {100 * QUANTILE:g} % below")
    for kind, parts in rows.items():
        X, y = (np.concatenate(p) for p in zip(*parts, strict=True))
        used = X.any(1)
        print(f"    {kind:15s}", np.round(pinball(X[used], y[used]), 5).tolist())


def table(every: Sequence[Compared]) -> None:
    """Coverage and sharpness of each channel."""
    heads = ("points", "covered %", "ratio", "true %", "stated %", *GRID_SIZE_FACTORS)
    print(f"{'channel':15s}" + "".join(f"{head:>10s}" for head in heads))
    found: dict[str, list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]] = {}
    for c in every:
        with of(c):
            said = error_estimate.stated_errors(c.settings, c.knobs, c.result)
        for name, bound in said.items():
            if name in ("time", "travel", "slipping") or not bound.any():
                continue
            kind = "uz(x,y)" if name.startswith("uz(") else "ux, uy(x,y)" if name[:3] in ("ux(", "uy(") else name
            found.setdefault(LABELS.get(name, kind), []).append(
                (c.settings.level, bound, c.true[name], np.abs(c.result.channels[name]))
            )
    for kind, rows in found.items():
        bound, true, size = (np.concatenate([r[i] for r in rows]) for i in (1, 2, 3))
        on = np.concatenate([np.full(len(r[1]), r[0]) for r in rows])
        inside, ratio = bound >= true, np.median(bound / np.maximum(true, 1e-6 * bound))
        shares = (100.0 * np.median(v / np.maximum(size, 1e-300)) for v in (true, bound))
        each = (100.0 * inside[on == level].mean() if (on == level).any() else np.nan for level in GRID_SIZE_FACTORS)
        numbers = (100.0 * inside.mean(), ratio, *shares, *each)
        print(f"{kind:15s}{len(true):10d}" + "".join(f"{v:10.2f}" for v in numbers))


def needed(seed: int, count: int, dear: int) -> list[tuple[int, int, str]]:
    """Keys (seed, k, level) of all runs, half models last."""
    keys = []
    for k in range(count):
        twin = draw(seed, k).twin
        more = ("fine", "reference")[: 1 + (k < dear)] if k < dear or not twin else ()
        keys += [(seed, k, level) for level in (*LEVELS, *(("meridian",) if twin else ()), *more)]
    return sorted(keys, key=lambda key: kind_of(*key[:2]) in (BESIDE, TILTED))


def main() -> None:
    """Make the runs that are not in the file yet, then print the fit and what it covers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=36)
    parser.add_argument("--more", type=int, default=24)
    parser.add_argument("--fresh", type=int, default=14)
    parser.add_argument("--effects", type=int, default=0)
    parser.add_argument("--dear", type=int, default=0)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    runs = {}
    if options.out and options.out.exists():
        for line in options.out.read_text().splitlines():
            one = json.loads(line)
            runs[one["seed"], one["k"], one["level"]] = one
    counts = {FIT: options.draws, MORE: options.more, EFFECTS: options.effects, FRESH: options.fresh}
    for seed, count in counts.items():
        for key in needed(seed, count, options.dear):
            if key not in runs:
                runs[key] = run(*key)
                print(*key, f"{runs[key]['cpu']:.1f} s", runs[key].get("failed", ""), flush=True)
                if options.out:
                    with options.out.open("a") as file:
                        file.write(json.dumps(runs[key]) + "\n")
    first, more, other, fresh = (list(compared(runs, seed)) for seed in counts)
    if first:
        fit(first + more)
    for words, every in (("fitted to", first + more), ("with other effects", other), ("kept back", fresh)):
        if every:
            print(f"\n{words}: {len({(c.seed, c.k) for c in every})} experiments, {len(every)} runs")
            table(every)


if __name__ == "__main__":
    main()
