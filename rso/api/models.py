"""Functions of numbers as backends."""

from __future__ import annotations

import dataclasses
import difflib
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import CodeType
from typing import Any

import numpy as np

from rso.contract import (
    Case,
    FreeCurve,
    Parameter,
    Programme,
    Response,
    digest,
    drop_neutral,
    worded,
)
from rso.contract.responses import ALWAYS_CHANNELS
from rso.evaluation.adapters import check_values

GIVEN_ARGUMENTS = ("travel", "time", "settings")  # arguments of a model's function that are no parameters
Declared = Parameter | tuple[float, float] | tuple[float, float, str] | tuple[str, ...]
Declarations = Mapping[str, Declared] | Sequence[Parameter]


@dataclass(frozen=True)
class FunctionModel:
    """A Python function as a backend: channels y(t, s; θ) (n,) at the times t (s) and travels s (mm) asked for.

    It can still be called as the function that it is, by keywords: ``spring(travel=s, k=2.0)``.  `fingerprint` is the
    hash of the function's source and code: a changed function has other runs.

    *Assumptions.* The function depends on its arguments only; what it reads elsewhere is not seen by the fingerprint.
    """

    function: Callable[..., Any]
    parameters: tuple[Parameter, ...]
    channels: Mapping[str, str]
    name: str
    fingerprint: str
    numerics: int = 1
    takes: frozenset[str] = field(default=frozenset())
    curves: Mapping[str, tuple[str, str, str]] = field(default_factory=dict)

    def free_curves(self) -> Mapping[str, tuple[str, str, str]]:
        """Name → unit, abscissa and its unit of the curves that it returns beside channels."""
        return self.curves

    def check(self, case: Case) -> None:
        """ValueError for settings where the function takes none."""
        if case.settings and "settings" not in self.takes:
            names = ", ".join(sorted(case.settings))
            raise ValueError(f"settings {names}: the function {self.name!r} has no argument `settings`")

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        """Effects at neutral dropped; a function that takes no time answers while loading only."""
        if "time" not in self.takes and not case.programme.still:
            case = dataclasses.replace(case, programme=Programme.ramp(case.programme.asked_mm))
        return drop_neutral(self.parameters, check_values(self.parameters, values)), case

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        """No artefacts."""
        return {}

    def make(self, recipe: str) -> bytes:
        """Never asked for."""
        raise ValueError(f"{self.name}: a function makes no artefacts (recipe {recipe!r})")

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """The response to (values, case) as every backend gives it; with keywords, what the function returns.

        Raises SimulationFailed if the function does, ValueError for what is no channel (n,).
        """
        if len(arguments) != 2 or keywords:
            return self.function(*arguments, **keywords)
        values, case = arguments
        time, travel = case.programme.passages()
        every = {"travel": travel, "time": time, "settings": dict(case.settings)}
        given = {name: every[name] for name in self.takes}
        found = self.function(**given, **worded(self.parameters, check_values(self.parameters, values)))
        if isinstance(found, Response):
            return found
        own = [*(name for name in self.channels if name not in ALWAYS_CHANNELS), *self.curves]
        returned = dict(found) if isinstance(found, Mapping) else {own[0]: found} if len(own) == 1 else {}
        if set(returned) != set(own):
            said = sorted(returned) if isinstance(found, Mapping) else type(found).__name__
            raise ValueError(f"{self.name} returned {said}; expected is a mapping of {', '.join(own)} to arrays")
        channels = {n: v for n, v in returned.items() if n not in self.curves}
        if lost := [n for n, v in returned.items() if v is None]:
            raise ValueError(f"{self.name} returned None as {lost[0]}; a number at each travel is expected")
        each = {n: np.full(travel.shape, v) if np.ndim(v) == 0 else v for n, v in channels.items()}
        curves = {n: self._curve(n, returned[n]) for n in self.curves}
        return Response({"time": time, "travel": travel, **each}, self.channels, curves=curves)

    def _curve(self, name: str, found: Any) -> FreeCurve:
        """A curve as declared; ValueError for what is no pair of abscissa and values."""
        if isinstance(found, FreeCurve):
            return found
        try:
            at, value = found
        except (TypeError, ValueError):
            raise ValueError(f"{self.name}: curve {name!r} must be a pair (abscissa, values)") from None
        return FreeCurve(at, value, *self.curves[name])


def model(
    *,
    parameters: Declarations,
    channels: Mapping[str, str] | None = None,
    curves: Mapping[str, tuple[str, str, str]] | None = None,
    name: str | None = None,
) -> Callable[[Callable[..., Any]], FunctionModel]:
    """Decorator that turns a function of numbers into a backend.

    `parameters` are :class:`rso.Parameter` each, or name → (low, high) or (low, high, unit): hard bounds.  A tuple of
    texts is a category, of which the function is given the text.  `channels` is name → unit of what the function
    returns; it is ``{"Fz": "N"}`` where neither it nor `curves` is given.  `curves` is name → (unit, abscissa, its
    unit) of pairs (abscissa, values) that the function returns beside.  Of its arguments ``travel`` (n,) mm, ``time``
    (n,) s and ``settings`` (mapping) are filled in by the experiment, all others are parameters.

        @rso.model(parameters={"k": (0.1, 10.0, "N/mm")})
        def spring(travel, k):
            return k * travel

    A study names it as ``use = "module:spring"``, or it is given to :func:`rso.load`.  Raises ValueError for arguments
    that are no declared parameter, and the other way round.
    """
    declared = tuple(parameters) if not isinstance(parameters, Mapping) else tuple(map(_declared, *_both(parameters)))

    def backend(function: Callable[..., Any]) -> FunctionModel:
        names = list(inspect.signature(function).parameters)
        own = {p.name for p in declared}
        declared_names = ", ".join(p.name for p in declared)
        if unknown := [n for n in names if n not in own and n not in GIVEN_ARGUMENTS]:
            near = difflib.get_close_matches(unknown[0], [*GIVEN_ARGUMENTS, *own], n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            given = ", ".join(GIVEN_ARGUMENTS)
            said = f"argument {unknown[0]!r} is no declared parameter ({declared_names}) and none of {given}"
            raise ValueError(f"{function.__name__}: {said}{hint}")
        if lost := sorted(own - set(names)):
            raise ValueError(f"{function.__name__}: parameter {lost[0]!r} is no argument of the function ({names})")
        return FunctionModel(
            function,
            declared,
            {**ALWAYS_CHANNELS, **({"Fz": "N"} if channels is None and curves is None else channels or {})},
            name or function.__name__,
            _source(function),
            takes=frozenset(names) & frozenset(GIVEN_ARGUMENTS),
            curves=dict(curves or {}),
        )

    return backend


def _both(parameters: Mapping[str, Declared]) -> tuple[list[str], list[Declared]]:
    return list(parameters), list(parameters.values())


def _declared(name: str, given: Declared) -> Parameter:
    """A parameter by its bounds; ValueError naming it for what is none."""
    if isinstance(given, Parameter):
        return given
    if isinstance(given, tuple | list) and len(given) > 1 and all(isinstance(v, str) for v in given):
        return Parameter(name, name, "1", 0.0, len(given) - 1.0, choices=tuple(map(str, given)))
    try:
        low, high, unit = given if len(given) == 3 else (*given, "1")
        if not float(low) < float(high):
            raise ValueError
    except (TypeError, ValueError):
        text = "(low, high) or (low, high, unit) with low < high, or texts to choose from, is expected"
        raise ValueError(f"parameter {name!r} = {given!r}: {text}") from None
    return Parameter(name, name, str(unit), float(low), float(high))


def _source(function: Callable[..., Any]) -> str:
    """Hash of the source, where there is one, and of the code: two functions may stand on one line."""
    try:
        text = inspect.getsource(function)
    except (OSError, TypeError):  # typed in where no source is kept
        text = ""
    return digest([text, _said(function.__code__)])


def _said(code: CodeType) -> list[Any]:
    """Instructions, names and constants of a code and those within, without addresses of this process."""
    constants = [_said(c) if isinstance(c, CodeType) else repr(c) for c in code.co_consts]
    return [code.co_code.hex(), list(code.co_names), constants]
