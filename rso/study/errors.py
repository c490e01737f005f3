"""What is wrong with a study file, in words: file, line, key, value, and what is allowed."""

from __future__ import annotations

import difflib
import types
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from rso.study.line_numbers import LineElsewhere, Place, line_of

_MAX_SHOWN_CHARACTERS, _MAX_MESSAGE_CHARACTERS = 60, 800  # of a key or a value in a message, and of a whole message
_MAX_LISTED_CHOICES, _N_NEAREST_CHOICES = 24, 8  # choices that are all listed; otherwise so many of the nearest


class StudyError(ValueError):
    """A study or one of its data files cannot be used; the text has one problem per line."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = tuple(problems)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.problems,)


@dataclass(frozen=True)
class Problem:
    """One thing wrong at one place; `value` is shown unless it is None or a table."""

    place: Place
    message: str
    value: Any = None


def study_error(file: Path, lines: Mapping[Place, int], problems: Iterable[Problem]) -> StudyError:
    """All problems of one file, in the order of its lines."""
    placed = sorted(((line_of(dict(lines), p.place), p) for p in problems), key=lambda pair: pair[0])
    return StudyError([_placed(file, line, p) for line, p in placed])


def _placed(file: Path, line: int, problem: Problem) -> str:
    """A problem with its file and line; in a table of specimens its column is named in place of the key."""
    if isinstance(line, LineElsewhere):
        return f"{line.file}:{int(line)}: {line.label}{_shown(problem.value)}: {_cut(problem.message)}"
    return f"{file}:{line}: {problem_text(problem)}"


def _cut(message: str) -> str:
    """A message may hold what the user wrote, of any length."""
    return message if len(message) <= _MAX_MESSAGE_CHARACTERS else message[:_MAX_MESSAGE_CHARACTERS] + "…"


def choices_text(name: str, choices: Iterable[str], first: Collection[str] = (), rest: str = "") -> str:
    """``did you mean 'mu'? choose from D1, mu``: the nearest names first, then all, or of many the nearest.

    Those of `first` that are among them come ahead of the others, and `rest` says where one sees what is left out.
    """
    known = sorted(choices)
    if not known:
        return "there is nothing to choose from"
    likely = [c for c in known if c in first]
    near = _nearest(name, likely, 2, 0.6) or _nearest(name, known, 2, 0.5)
    hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
    if len(known) <= (_N_NEAREST_CHOICES if first else _MAX_LISTED_CHOICES):
        return f"{hint}choose from {', '.join([*likely, *(c for c in known if c not in likely)])}"
    ahead = _nearest(name, likely, _N_NEAREST_CHOICES, 0.0)
    others = _nearest(name, [c for c in known if c not in likely], _N_NEAREST_CHOICES, 0.0)
    some = [*ahead, *others][:_N_NEAREST_CHOICES]
    return f"{hint}choose from {', '.join(some)} and {len(known) - len(some)} more{rest and f': {rest}'}"


def _nearest(name: str, choices: Sequence[str], count: int, cutoff: float) -> list[str]:
    """So many of the choices at most, the nearest to a name first, whatever their case."""
    by_lower = {c.lower(): c for c in choices}
    return [by_lower[m] for m in difflib.get_close_matches(name.lower(), by_lower, n=count, cutoff=cutoff)]


def schema_problems(model: type[BaseModel], error: ValidationError) -> list[Problem]:
    """The problems that pydantic found, in our words."""
    return [_problem(model, e) for e in error.errors(include_url=False)]


def problem_text(problem: Problem, above: Place = ()) -> str:
    """A problem as key, value and message; `above` is where the table stands."""
    return f"{_dotted((*above, *problem.place))}{_shown(problem.value)}: {_cut(problem.message)}"


def _problem(model: type[BaseModel], error: Mapping[str, Any]) -> Problem:
    place, kind, value = tuple(error["loc"]), error["type"], error["input"]
    if kind == "extra_forbidden":
        return Problem(place, f"unknown key; {choices_text(str(place[-1]), _keys_at(model, place[:-1]))}", value)
    if kind == "missing":
        return Problem(place, "is missing and has no default")
    message = error["msg"].removeprefix("Value error, ")
    if kind == "literal_error":
        message = f"allowed is {error['ctx']['expected']}"
        if isinstance(value, str):
            near = difflib.get_close_matches(value, error["ctx"]["expected"].replace("'", " ").split(), n=1)
            message += f"; did you mean {near[0]!r}?" if near else ""
    elif kind in ("tuple_type", "list_type"):
        message = "expected an array: [...], or [[...]] for tables"
    elif kind in ("model_type", "dict_type", "model_attributes_type"):
        message = "expected a table"
    return Problem(place, message.replace("Input should be", "should be"), value)


def _keys_at(model: type[BaseModel], place: Place) -> list[str]:
    """Keys that the table at `place` may have."""
    keys = iter(place)
    for key in keys:
        if isinstance(key, int):
            continue
        annotation = model.model_fields[key].annotation
        inner = _model_in(annotation)
        if inner is None:
            return []
        model = inner
        if getattr(annotation, "__origin__", None) is dict:
            next(keys, None)  # the user's own name
    return list(model.model_fields)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The model inside an annotation such as tuple[Target, ...]."""
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        return annotation if issubclass(annotation, BaseModel) else None
    return next((m for a in get_args(annotation) if (m := _model_in(a)) is not None), None)


def _dotted(place: Place) -> str:
    """``search.targets[0].depth``"""
    words = [
        key if isinstance(key, int) else key if len(key) <= _MAX_SHOWN_CHARACTERS else key[:_MAX_SHOWN_CHARACTERS] + "…"
        for key in place
    ]
    text = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in words)
    return text.removeprefix(".") or "study file"


def _shown(value: Any) -> str:
    if value is None or isinstance(value, dict | BaseModel):
        return ""
    text = repr(value)
    return f" = {text if len(text) <= _MAX_SHOWN_CHARACTERS else text[:_MAX_SHOWN_CHARACTERS] + '…'}"
