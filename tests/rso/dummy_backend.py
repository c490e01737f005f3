"""A backend for tests of dispatch: sleeps, fails, crashes, kills its process; writes down every call it gets."""

import os
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rso.contract import Case, Parameter, Response, SimulationFailed, drop_neutral

PARAMETERS = (
    Parameter("x", "what the answer depends on", "1", -1e6, 1e6),
    Parameter("lag", "an effect", "1", 0.0, 1.0, default=0.0, neutral=0.0),
)


@dataclass(frozen=True)
class Dummy:
    """F = x u + lag; ``settings["do"]`` says what happens, ``settings["log"]`` where calls are noted."""

    name: str = "dummy"
    numerics: int = 1

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return PARAMETERS

    @property
    def channels(self) -> Mapping[str, str]:
        return {"time": "s", "travel": "mm", "Fz": "N"}

    def check(self, case: Case) -> None:
        if unknown := sorted(set(case.settings) - {"do", "log", "sleep_s", "mesh"}):
            raise ValueError(f"unknown settings {unknown}")

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        return drop_neutral(PARAMETERS, values), case

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        return {"mesh": case.settings["mesh"]} if "mesh" in case.settings else {}

    def make(self, recipe: str) -> bytes:
        what, log = recipe.split("@")
        note(log, f"make {what}")
        if what == "impossible":
            raise SimulationFailed("bad_geometry", "no such body")
        if what == "slow":
            time.sleep(1.5)
            note(log, "made slow")
        if what == "buggy":
            raise ZeroDivisionError("a bug in the mesher")
        return what.encode()

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        do, log = case.settings.get("do", ""), case.settings.get("log")
        note(log, f"begin {values['x']:g} {os.getpid()}")
        time.sleep(case.settings.get("sleep_s", 0.0))
        u = np.array(case.programme.asked_mm)
        response = Response(
            {"time": u, "travel": u, "Fz": np.sin(values["x"]) * u / 3.0 + values.get("lag", 0.0)},
            self.channels,
            {"Fz": 1e-3},
            info={"mesh": None if (m := case.artefact("mesh")) is None else m.read_text(), "pair": (1, 2)},
        )
        match do:
            case "fail":
                raise SimulationFailed("step_limit", "too soft", response, ({"step": 1, "residual": np.float64(0.1)},))
            case "late":
                raise SimulationFailed("time_limit", "the time of the run is used up")
            case "crash":
                raise ZeroDivisionError("a bug")
            case "exit":
                os._exit(7)
            case "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            case "crash once" if calls(log, f"begin {values['x']:g} ") == 1:
                raise ZeroDivisionError("a bug")
        note(log, f"end {values['x']:g}")
        return response


BACKEND = Dummy()


def note(log: str | None, line: str) -> None:
    """Append a line; short appends are atomic, also across processes and kill -9."""
    if log is not None:
        with open(log, "ab", buffering=0) as f:
            f.write(f"{line}\n".encode())


def calls(log: str, beginning: str) -> int:
    """How many noted lines begin like this."""
    path = Path(log)
    return sum(line.startswith(beginning) for line in path.read_text().splitlines()) if path.exists() else 0


def square(x: float) -> float:
    return x * x


def environment(names: tuple[str, ...]) -> dict[str, str | None]:
    return {name: os.environ.get(name) for name in names}


def sleep(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def die_elsewhere(home: tuple[int, int]) -> int:
    """Kills every process but the one at home."""
    pid, x = home
    if os.getpid() != pid:
        os._exit(7)
    return x


def fail(reason: str) -> None:
    raise SimulationFailed("contact", reason, Response({"time": [0.0], "travel": [0.1]}, {"time": "s", "travel": "mm"}))


class Twisted(Exception):
    """Does not survive pickling: its arguments are not its constructor's."""

    def __init__(self, a: int, b: int) -> None:
        super().__init__("only one")


def twist() -> None:
    raise Twisted(1, 2)


def leave() -> None:
    raise SystemExit(3)


def unpicklable() -> object:
    return lambda: None
