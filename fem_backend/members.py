"""Open sets of members, one file each, and the pydantic tables by which settings choose and describe one."""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
import functools
import importlib
import math
import os
import pkgutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType, ModuleType
from typing import Annotated, Any, Generic, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, GetCoreSchemaHandler, TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError, core_schema

from rso.contract import Option

Member = TypeVar("Member")


class MemberTable(BaseModel):
    """A table of settings: no unknown keys, no conversions, no changes afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)


@dataclass(frozen=True, kw_only=True)
class SettingsOption(Option):
    """An option of `rso new` and the tables of settings that its values mean, by their nouns.

    A table with the tag of its set chooses a member; one that `adds` has none, and adds to what another option chooses.
    `guess` says what stands there for values that were left out, `left_out` makes them from those given and the depth
    (mm) of the shallowest record, where there is one.
    """

    settings: Callable[..., Mapping[str, Mapping[str, Any]]]
    adds: bool = False
    guess: str = ""
    left_out: Callable[[Sequence[float | str], float], Sequence[float | str]] | None = None

    def completed(self, values: Sequence[float | str], depths: Sequence[float]) -> tuple[float | str, ...]:
        """The values with those that were left out, as far as the depths (mm) of records show them."""
        depth = min((d for d in depths if d > 0.0), default=0.0)
        few = len(values) < len(self.words)
        return tuple(self.left_out(values, depth)) if self.left_out and few and depth else tuple(values)


def length_words(mm: float) -> str:
    """A length (mm) with the unit that people use for it, from nm to m."""
    for unit, size in (("m", 1e3), ("mm", 0.1), ("µm", 1e-4)):
        if abs(mm) >= size or mm == 0.0:
            return f"{mm / {'m': 1e3, 'mm': 1.0, 'µm': 1e-3}[unit]:.4g} {unit}" if mm else "0 mm"
    return f"{mm * 1e6:.4g} nm"


@dataclass(frozen=True, eq=False)
class OpenSet(Generic[Member]):
    """Members by name: the table `noun` of the settings names one by its key `tag`, `default` where it says nothing.

    A member is a class with `name`, a `Table` (a pydantic model whose `build()` returns an instance), and `Knobs`, a
    dataclass of the knobs that exist only with it, or None.  `marks` are keys with a revision number that the backend
    writes into canonical settings by itself, with the highest.
    """

    noun: str
    tag: str
    default: str
    marks: Mapping[str, int] = field(default_factory=dict)
    members: dict[str, Any] = field(default_factory=dict)

    def register(self, member: Any) -> Any:
        """Add a member class under its name, also as a decorator; ValueError for a name that is taken."""
        if member.name in self.members:
            raise ValueError(f"{self.noun}: there is a member {member.name!r} already")
        self.members[member.name] = member
        return member

    def discover(self, folder: ModuleType, first: Sequence[str] = ()) -> None:
        """Import every module of a folder, so that a member's file registers itself by being there.

        Members are offered in the order of their registration: modules `first`, the others by name.
        """
        found = sorted(info.name for info in pkgutil.iter_modules(folder.__path__))
        for name in [*first, *(n for n in found if n not in first)]:
            importlib.import_module(f"{folder.__name__}.{name}")

    def knobs(self) -> list[type]:
        """Dataclasses of the knobs that members own."""
        return [m.Knobs for m in self.members.values() if m.Knobs is not None]

    def options(self) -> list[SettingsOption]:
        """Options of `rso new` that members declare, each once."""
        return list(dict.fromkeys(o for m in self.members.values() for o in getattr(m, "options", ())))

    def own(self, name: str) -> frozenset[str]:
        """Names of the knobs that exist only with a member."""
        knobs = self.members[name].Knobs
        return frozenset() if knobs is None else frozenset(f.name for f in dataclasses.fields(knobs))

    def of_others(self, name: str) -> frozenset[str]:
        """Names of the knobs that exist only with members other than this one."""
        return _of_others(tuple((n, m.Knobs) for n, m in self.members.items()), name)

    def read(self, value: Any) -> Any:
        """The member that a table describes; ValueError with every problem, one a line."""
        try:
            return _adapter(self, tuple(self.members.items())).validate_python(value).build()
        except ValidationError as error:
            raise ValueError("\n".join(problems(error, {self.noun: self}, (self.noun,)))) from error

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        """A discriminated union of the members' tables; an annotation `Annotated[Any, members]` makes a field of it."""
        union = core_schema.tagged_union_schema(
            choices={name: handler.generate_schema(m.Table) for name, m in self.members.items()},
            discriminator=lambda v: v.get(self.tag, self.default) if isinstance(v, dict) else self.default,
        )
        return core_schema.no_info_before_validator_function(self._without_marks, union)

    def _others_that_have(self, value: Mapping[str, Any]) -> tuple[str, list[str]] | None:
        """The first key of a table without its tag that the default does not have, and the members that have it."""
        of = {n: m.Table.model_fields for n, m in self.members.items()}
        for key in (k for k in value if k not in of[self.default]):
            if names := [n for n, fields in of.items() if key in fields]:
                return key, names
        return None

    def _without_marks(self, value: Any) -> Any:
        """The table without the backend's own marks; refuses what is no table or names no member."""
        if not isinstance(value, Mapping):
            keys = dict.fromkeys(k for m in self.members.values() for k in m.Table.model_fields)
            raise refused(f": a table with the keys {', '.join(keys)} is expected")
        tag = value.get(self.tag, self.default)
        if not isinstance(tag, str) or tag not in self.members:
            raise refused(f" is not modelled; {nearest_choices(str(tag), list(self.members))}", self.tag, tag)
        if self.tag not in value and (others := self._others_that_have(value)):
            key, names = others
            raise refused(
                f" is missing: {key} belongs to {', '.join(names)}; a table without {self.tag} is that of {tag!r}",
                self.tag,
                MISSING,
            )
        known = {k: most for k, most in self.marks.items() if k in getattr(self.members[tag], "marks", self.marks)}
        return {k: v for k, v in value.items() if not is_revision_mark(k, v, known)}


@functools.lru_cache(maxsize=128)
def _of_others(knobs: tuple[tuple[str, type | None], ...], name: str) -> frozenset[str]:
    names = {n: {f.name for f in dataclasses.fields(k)} if k is not None else set() for n, k in knobs}
    return frozenset().union(*names.values()) - names[name]


def is_revision_mark(key: str, value: object, marks: Mapping[str, int]) -> bool:
    """Whether a key is a mark of the backend with one of its revision numbers; stored runs may have an earlier one."""
    return type(value) is int and key in marks and 1 <= value <= marks[key]


def nearest_choices(word: str, choices: Sequence[str]) -> str:
    """The nearest choice, if one is near, and all of them."""
    near = difflib.get_close_matches(word, choices, n=1)
    return f"{f'did you mean {near[0]!r}? ' if near else ''}choose from {', '.join(choices)}"


# ------------------------------------------------------------------------------------------------- problems in words


MISSING = object()  # the value of a key that is not there


def refused(text: str, key: str = "", value: Any = None) -> PydanticCustomError:
    """An error whose sentence is `key = value` and the text: of a `key` below the place, with the `value` as read.

    With the value `MISSING` the sentence is the key and the text.
    """
    return PydanticCustomError("refused", "{text}", {"text": text, "key": key, "value": value})


def problems(
    error: ValidationError,
    sets: Mapping[str, OpenSet],
    below: tuple[str, ...] = (),
    known: Mapping[tuple[str, ...], Sequence[str]] = MappingProxyType({}),
) -> list[str]:
    """Every problem of a failed validation as one sentence: key, value, what is expected or the choices.

    `sets` are the open sets by the key of their table, `below` the place of what was validated, `known` the keys of
    other tables by their place.
    """
    out = []
    for e in error.errors():
        place = (*below, *(p for p in e["loc"] if isinstance(p, str)))
        given, own, keys = e["input"], e.get("ctx", {}), known.get(place[:-1], ())
        if place and place[0] in sets and place[1:2] and place[1] in sets[place[0]].members:
            keys = list(sets[place[0]].members[place[1]].Table.model_fields)
            place = (place[0], *place[2:])
        if e["type"] == "refused":
            place = (*place, own["key"]) if own["key"] else place
            given = given if own["value"] is None else own["value"]
            out.append(f"{'.'.join(place)}{own['text'] if given is MISSING else f' = {given!r}' + own['text']}")
        elif e["type"] == "extra_forbidden":
            text = f"{'.'.join(place)} = {given!r}: unknown" if place[1:] else f"unknown setting {place[0]!r}"
            out.append(f"{text}; {nearest_choices(place[-1], keys)}")
        elif e["type"] == "missing":
            out.append(f"{'.'.join(place)} is missing, which {'.'.join(place[:-1]) or 'this case'} = {given!r} needs")
        else:
            out.append(f"{'.'.join(place)} = {given!r}: {e['msg']}")
    return out


# ------------------------------------------------------------------------------------------------- kinds of values


def is_finite(value: object) -> bool:
    """Whether a value is a finite real number that is no truth value."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def finite_number(value: Any) -> float:
    """One finite number."""
    return numbers(1)(value)[0]


def numbers(count: int) -> Callable[[Any], tuple[float, ...]]:
    """A validator of so many finite numbers; one alone is no list."""

    def check(value: Any) -> tuple[float, ...]:
        given = [value] if count == 1 else value
        good = isinstance(given, list | tuple) and len(given) == count
        if not good or not all(map(is_finite, given)):
            text = any(isinstance(v, str) for v in given) if good else isinstance(given, str)
            plain = ", without quotes and units: lengths are in mm" if text else ""
            raise refused(f": {count} finite number(s) expected{plain}")
        return tuple(float(v) for v in given)

    return check


def lengths(count: int) -> Callable[[Any], Any]:
    """A validator of so many positive lengths in mm; one alone is no list."""

    def check(value: Any) -> Any:
        given = numbers(count)(value)
        if min(given) <= 0.0:
            raise refused(" mm: must be positive", value=given[0] if count == 1 else list(given))
        return given[0] if count == 1 else given

    return check


def at_least(low: float, words: str) -> Callable[[Any], float]:
    """A validator of one finite number that is not below `low`."""

    def check(value: Any) -> float:
        if finite_number(value) < low:
            raise refused(f": {words}", value=float(value))
        return float(value)

    return check


def above(low: float, words: str) -> Callable[[Any], float]:
    """A validator of one finite number above `low`."""

    def check(value: Any) -> float:
        if finite_number(value) <= low:
            raise refused(f": {words}", value=float(value))
        return float(value)

    return check


def flag(value: Any) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise refused(": true or false is expected")
    return value


def one_of(choices: Iterable[str]) -> Callable[[Any], str]:
    """A validator of one of some words."""
    known = list(choices)

    def check(value: Any) -> str:
        if not isinstance(value, str) or value not in known:
            raise refused(f" is not modelled; {nearest_choices(str(value), known)}")
        return value

    return check


def stamps_of(text: str, value: Any) -> tuple[tuple[str, int, int], ...]:
    """The :func:`stamps` of tables whose JSON is `text`: most name no file, which that shows at once."""
    return stamps(value) if '"file"' in text else ()


def stamps(value: Any) -> tuple[tuple[str, int, int], ...]:
    """Place, time of the last change (ns) and size of every file that tables of settings name by `file`."""
    found: list[tuple[str, int, int]] = []
    for key, inner in value.items() if isinstance(value, Mapping) else ():
        found += stamps(inner)
        if key == "file" and isinstance(inner, str):
            with contextlib.suppress(OSError, ValueError):
                about = os.stat(inner)
                found.append((inner, about.st_mtime_ns, about.st_size))
    return tuple(found)


def read_in(unit: str) -> Any:
    """What says, beside a field of a table, the unit that its numbers are in; without it they have none."""
    return Field(json_schema_extra={"unit": unit})


Length = Annotated[float, BeforeValidator(lengths(1)), read_in("mm")]
Three = Annotated[tuple[float, float, float], BeforeValidator(lengths(3)), read_in("mm")]
Flag = Annotated[bool, BeforeValidator(flag)]


@functools.lru_cache(maxsize=64)
def _adapter(kind: OpenSet, members: tuple[tuple[str, Any], ...]) -> TypeAdapter:
    """The validator of a table of an open set with these members."""
    return TypeAdapter(Annotated[Any, kind])
