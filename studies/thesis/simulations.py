"""Every simulation behind the tables of the thesis: what is run, and the store that keeps it.

The reference is the source's second model: a specimen of 60 x 35 x 35 mm in a bowl (clearance 1 mm, which the source
does not say), a ball of 3 mm with a shaft, no friction at the ball, no weight.  The bowl's friction of 0.2 is left out
at the top: it changes the force there by less than the mesh does (runs "friction") and takes several times as long.
"""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from fem_backend.backend import BACKEND, FiniteElements
from fem_backend.simulation.assembly import multiplicity
from rso.contract import Backend, Case, Programme, Response
from rso.evaluation import Event, Outcome, Task, run_all
from rso.evaluation.store import RunStore

FOLDER = Path(__file__).parent
PRINTED: Mapping[str, Any] = tomllib.loads((FOLDER / "printed.toml").read_text(encoding="utf-8"))
SETS = {name: (row["mu_Pa"] * 1e-6, row["D1"]) for name, row in PRINTED["sets"].items()}  # MPa, 1/MPa

BOWL = {"kind": "bowl", "clearance": 1.0, "friction": 0.0}
FRICTION = 0.2  # of the source, used where it matters and to show that it does not
HELD = {"kind": "fixed"}
WEIGHT = 1e-5  # N/mm^3, that of water

MU = 0.01  # MPa: forces at other moduli follow from F(mu, D1) = mu f(mu D1)
# mu D1 over the source's full range, 0.0034 to 6.18, closer where D1 matters, and where its sets lie.
GRID = (0.0033, 0.006, 0.025, 0.11, 0.22, 0.45, 0.9, 3.3, 6.3)
FAMILY = tuple(sorted({*GRID, *(round(math.prod(SETS[s]), 6) for s in ("1", "3", "4"))}))

TO_4 = (0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 3.9, 4.0)
STEPS = tuple(0.5 * k for k in range(1, 9))
TO_8 = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)
WHOLE = (1.0, 2.0, 3.0, 4.0)
LINE = tuple(2.5 * k for k in range(9))  # mm along x; the line lies 5 mm beside the axis
PROFILE = [[x, 5.0] for x in LINE]
LEVELS = ("coarse", "standard", "fine", "reference")
# The blue point, the three nearby points, and the last of the five points on the diagonal.
POINTS = {
    "blue": (2.5, 2.5),
    "10, 10": (10.0, 10.0),
    "20, 0": (20.0, 0.0),
    "0, 20": (0.0, 20.0),
    "20, 20": (20.0, 20.0),
}


def task(
    name: str,
    mu: float,
    D1: float,
    asked: Sequence[float],
    support: Mapping[str, Any] = BOWL,
    *,
    level: str = "coarse",
    knobs: Mapping[str, float] | None = None,
    **settings: Any,
) -> Task:
    """One simulation; the ball has a shaft unless `indenter` says otherwise."""
    indenter = settings.pop("indenter", {"shape": "sphere", "radius": 3.0, "shaft": True})
    whole = {"support": dict(support), "indenter": indenter, "mesh": {"level": level}, **settings}
    return Task({"mu": mu, "D1": D1, **(knobs or {})}, Case(name, Programme.ramp(tuple(asked)), whole))


def family(support: Mapping[str, Any], label: str) -> dict[str, Task]:
    """Runs over mu D1 at mu = MU; at the top nothing else than this product changes the shape of a curve."""
    return {f"{label} {x:g}": task(f"{label} {x:g}", MU, x / MU, TO_4, support, profile=PROFILE) for x in FAMILY}


def of_set(label: str, name: str) -> str:
    """The run of a family that is a set of the source but for its modulus."""
    return f"{label} {round(math.prod(SETS[name]), 6):g}"


def plan() -> dict[str, Task]:
    """Every other simulation by name, the dear ones last."""
    out: dict[str, Task] = {}

    def add(name: str, *arguments: Any, **more: Any) -> None:
        out[name] = task(name, *arguments, **more)

    rubbing = BOWL | {"friction": FRICTION}
    bare = {"shape": "sphere", "radius": 3.0}
    mu, D1 = SETS["3"]
    for s in ("4", "3", "1"):
        add(f"set {s} 8 mm bowl", *SETS[s], TO_8)
        add(f"set {s} 8 mm held", *SETS[s], TO_8, HELD)
    first = PRINTED["em1"]
    asked = (*TO_4[1:-3], 3.3, first["depth_mm"])
    for place, point in (("top", [0.0, 0.0]), ("nearby", [0.0, 5.0])):
        add(f"EM I {place}", first["mu_MPa"], first["D1"], asked, HELD, knobs={"cavity": 1.0}, point=point)
    add("EM I top no cavity", first["mu_MPa"], first["D1"], asked, HELD)
    add("EM I top friction", first["mu_MPa"], first["D1"], asked, HELD, knobs={"cavity": 1.0, "friction": 0.3})
    E, nu = first["E_Hertz_MPa"], 0.49
    add(
        "EM I linear",
        E / (2 * (1 + nu)),
        6 * (1 - 2 * nu) / E,
        (*TO_4[:5], 3.0, first["depth_mm"]),
        HELD,
        knobs={"cavity": 1.0},
        material={"law": "linear_elastic"},
    )
    add("level coarse held", mu, D1, (0.4, *WHOLE), HELD)
    add(f"set 3 friction {FRICTION:g}", mu, D1, STEPS, rubbing, profile=PROFILE)
    for s in ("4", "3", "1"):
        add(f"set {s} 8 mm ball", *SETS[s], TO_8, indenter=bare)
    for name in ("blue", "20, 0", "0, 20", "20, 20"):
        add(f"point {name} vertical", mu, D1, WHOLE, HELD, point=list(POINTS[name]))
    add("set 3 weight", mu, D1, STEPS, rubbing, knobs={"weight": WEIGHT}, profile=PROFILE)
    add("level standard held", mu, D1, (0.4, *WHOLE), HELD, level="standard")
    add("level fine held", mu, D1, (0.4, *WHOLE), HELD, level="fine")
    for name in ("20, 0", "0, 20", "blue"):
        add(f"point {name} normal", mu, D1, WHOLE, HELD, point=list(POINTS[name]), direction="normal")
    for s, what, value in (
        ("3", "clearance", 0.5),
        ("3", "clearance", 2.0),
        ("4", "clearance", 2.0),
        ("4", "friction", FRICTION),
    ):
        add(f"set {s} {what} {value:g}", *SETS[s], STEPS, BOWL | {what: value}, profile=PROFILE)
    add("set 4 weight", *SETS["4"], STEPS, rubbing, knobs={"weight": WEIGHT}, profile=PROFILE)
    add("level standard bowl", mu, D1, (0.4, *WHOLE), level="standard")
    add("point 20, 20 normal", mu, D1, WHOLE, HELD, point=list(POINTS["20, 20"]), direction="normal")
    add("level standard 8 mm", mu, D1, TO_8, HELD, level="standard")
    for s in ("4", "3"):
        add(f"set {s} 8 mm weight", *SETS[s], TO_8, rubbing, knobs={"weight": WEIGHT})
    add("point 10, 10 vertical", mu, D1, WHOLE, HELD, point=list(POINTS["10, 10"]))
    add("level reference held", mu, D1, (0.4, *WHOLE), HELD, level="reference")
    add("bowl blue weight", mu, D1, WHOLE, rubbing, point=list(POINTS["blue"]), knobs={"weight": WEIGHT})
    add("bowl blue", mu, D1, WHOLE, rubbing, point=list(POINTS["blue"]))
    return out


@dataclasses.dataclass(frozen=True)
class HalfModel(FiniteElements):
    """The same finite elements, with what a model of one half (y >= 0) reads off its ball: force of the ball's half.

    `Fy_half` (N) is what the half's contact pushes to the side; in the whole specimen the other half cancels it.
    Off the top, where nothing is cut at y = 0, it is 0.
    """

    name: str = "fem_backend, half"

    @property
    def channels(self) -> Mapping[str, str]:
        """Those of the backend and Fy_half."""
        return {**super().channels, "Fy_half": "N"}

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        """The mesh alone: nearly every run here is the only one of its kind, for which an anchor saves nothing."""
        return {k: v for k, v in super().recipes(values, case).items() if k == "mesh"}

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        """As the backend, with one channel more."""
        solved = self.solve(values, case)
        response = self.response(solved)
        images = multiplicity(solved.placement) / 2 if solved.placement.planes[1] else 0.0
        pushed = np.array([images * p.force[1] for p in solved.result.points])
        return dataclasses.replace(
            response, channels={**response.channels, "Fy_half": pushed}, units={**response.units, "Fy_half": "N"}
        )


MODEL = HalfModel()


def compute(
    results: Path, watch: Callable[[Event], None] | None = None, many: Backend = BACKEND, single: Backend = MODEL
) -> dict[str, Outcome]:
    """Outcome of every simulation on one core, those of an earlier call from the store in `results`.

    `many` runs the families (from anchors), `single` the rest.
    """
    outcomes: dict[str, Outcome] = {}
    with RunStore(results) as store, ThreadPoolExecutor(1) as here:
        for backend, wanted in ((many, family(BOWL, "bowl") | family(HELD, "held")), (single, plan())):
            found = run_all(backend, list(wanted.values()), store, here, retries=0, watch=watch)
            outcomes |= zip(wanted, found, strict=True)
    return outcomes


def stored(results: Path) -> dict[str, Outcome]:
    """Every simulation that the store holds, by name."""
    outcomes: dict[str, Outcome] = {}
    with RunStore(results, read_only=True) as store:
        for row in store.rows():
            if (found := store.get(row.key)) is not None:
                outcomes[row.name] = found
    return outcomes


def main() -> None:
    """Run what is missing and say how each ended."""
    outcomes = compute(FOLDER / "results" / "simulations", watch=lambda e: print(e, flush=True))
    for name, o in outcomes.items():
        print(f"{name:28s} {type(o).__name__:8s} {getattr(o, 'cpu_s', 0.0):7.1f} s {getattr(o, 'reason', '')[:150]}")


if __name__ == "__main__":
    main()
