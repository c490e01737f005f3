"""Several backends as one: each experiment has its own, and parameters of one name are one parameter."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rso.contract import Backend, Case, Fingerprint, Parameter, Response, capability, digest

BACKEND_SETTING = "backend"  # the key of settings that names a further backend; without it the first one answers
_RECIPE_SEPARATOR = "|"  # the name of a backend and its recipe

# What the first backend may be asked beside its answers, and what holds of a further one that cannot say:
ASKED_BY_SETTINGS: Mapping[str, tuple[int, Any]] = {  # the place of the settings among the arguments
    "relaxes": (1, False),
    "controls_force": (0, False),
    "uncalibrated": (0, None),
    "resolution": (0, {}),
    "variants": (0, {}),
}
ASKED_BY_CASE: Mapping[str, tuple[int, Any]] = {
    "refused": (1, None),
    "cost": (1, 0.01),
    "reduction": (1, None),
    "formulas": (1, ()),
}
# What any of them may be asked, whether or not the first can say it:
ASKED_OF_ANY: Mapping[str, tuple[int, Any]] = {
    "plausible": (0, {}),
    "nominal": (0, {}),
    "gauges": (0, {}),
    "dimensions": (0, None),
    "setting_unit": (0, None),
}
ASKED_OF_FIRST = ("derived", "physical", "ordinary")


@dataclass(frozen=True)
class JointBackend:
    """The first backend and further ones by name, as a backend whose parameters and channels are those of all.

    A run of a further one is keyed by its own parameters alone, so that what moves only the others runs it once.
    """

    first: Backend
    others: Mapping[str, Backend]
    name: str
    parameters: tuple[Parameter, ...]
    channels: Mapping[str, str]
    fingerprint: str
    numerics: int = 1

    def check(self, case: Case) -> None:
        """As the backend of the case does."""
        one, _, own = self._of(case)
        one.check(own)

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        """As the backend of the case does, with its own parameters alone."""
        one, name, own = self._of(case)
        kept, found = one.canonical(_mine(one, values), own)
        return kept, _routed(found, name)

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        """Those of the backend of the case."""
        one, name, own = self._of(case)
        return {k: f"{name}{_RECIPE_SEPARATOR}{r}" for k, r in one.recipes(_mine(one, values), own).items()}

    def make(self, recipe: str) -> bytes:
        """By the backend whose recipe it is."""
        name, _, rest = recipe.partition(_RECIPE_SEPARATOR)
        return (self.others[name] if name else self.first).make(rest)

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        """The answer of the backend of the case."""
        one, _, own = self._of(case)
        return one(_mine(one, values), own)

    def _of(self, case: Case) -> tuple[Backend, str, Case]:
        """The backend of a case, its name ("" of the first), and the case without the route."""
        name = str(case.settings.get(BACKEND_SETTING, ""))
        settings = {k: v for k, v in case.settings.items() if k != BACKEND_SETTING}
        return self._named(name), name, dataclasses.replace(case, settings=settings)

    def _named(self, name: str) -> Backend:
        if name and name not in self.others:
            raise ValueError(f"{BACKEND_SETTING} = {name!r}: there are {', '.join(self.others)}")
        return self.others[name] if name else self.first

    def __getattr__(self, name: str) -> Any:
        """What may be asked beside the answers: of the backend of the settings or of the case."""
        if name in ASKED_OF_ANY and any(getattr(b, name, None) for b in (self.first, *self.others.values())):
            return self._asked(name, getattr(self.first, name, None))
        if name in ASKED_OF_FIRST or name in ASKED_BY_SETTINGS or name in ASKED_BY_CASE:
            own = getattr(self.first, name)
            return own if name in ASKED_OF_FIRST else self._asked(name, own)
        raise AttributeError(name)

    def _asked(self, name: str, own: Callable[..., Any] | None) -> Callable[..., Any]:
        place, otherwise = {**ASKED_BY_SETTINGS, **ASKED_BY_CASE, **ASKED_OF_ANY}[name]

        def ask(*arguments: Any) -> Any:
            given = list(arguments)
            if name in ASKED_BY_CASE:
                one, route, given[place] = self._of(given[place])
                given[0] = _mine(one, given[0])
            else:
                route = str(given[place].get(BACKEND_SETTING, ""))
                one, given[place] = self._named(route), {k: v for k, v in given[place].items() if k != BACKEND_SETTING}
            answer = own if not route else getattr(one, name, None)
            return otherwise if answer is None else answer(*given)

        return ask


def joint(first: Backend, others: Mapping[str, Backend]) -> JointBackend:
    """Backends as one; ValueError where parameters or channels of one name have different units."""
    parameters: dict[str, Parameter] = {}
    channels: dict[str, str] = {}
    for label, one in {"": first, **others}.items():
        where = f"backends.{label}" if label else "backend"
        for p in one.parameters:
            known = parameters.get(p.name)
            if known is not None and (known.unit, known.choices) != (p.unit, p.choices):
                raise ValueError(f"{where}: parameter {p.name} is in {p.unit}, that of another backend in {known.unit}")
            if known is None:
                parameters[p.name] = p
            else:  # what all of them take
                low, high = max(known.low, p.low), min(known.high, p.high)
                if low > high:
                    raise ValueError(f"{where}: parameter {p.name} has no value that all backends take")
                parameters[p.name] = dataclasses.replace(known, low=low, high=high)
        for channel, unit in one.channels.items():
            if channels.setdefault(channel, unit) != unit:
                raise ValueError(
                    f"{where}: channel {channel} is in {unit}, that of another backend in {channels[channel]}"
                )
    every = {"": first, **others}
    marks = {
        k: [b.name, b.numerics, f.fingerprint if (f := capability(b, Fingerprint)) else ""] for k, b in every.items()
    }
    name = " + ".join(dict.fromkeys(b.name for b in every.values()))
    return JointBackend(first, dict(others), name, tuple(parameters.values()), channels, digest(marks))


def _mine(one: Backend, values: Mapping[str, float]) -> dict[str, float]:
    """The values that a backend knows."""
    names = {p.name for p in one.parameters}
    return {k: v for k, v in values.items() if k in names}


def _routed(case: Case, name: str) -> Case:
    return dataclasses.replace(case, settings={**case.settings, BACKEND_SETTING: name}) if name else case
