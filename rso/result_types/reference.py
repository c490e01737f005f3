"""Every key of every result file, from the types themselves: the page docs/results.md, and JSON schemas."""

from __future__ import annotations

from collections.abc import Iterator
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from rso.result_types import RESULT_FILES, ResultBlock

SCHEMA_DIALECT = "https://json-schema.org/draft/2020-12/schema"
RESULTS_PAGE_HEAD = """# Result files

`rso keys results` prints this page, `rso keys results.json` the part on one file, `rso keys results.json --schema`
its JSON schema. What the analyses do is in [analyses](analyses.md). Without a unit here numbers are in N, mm, MPa
and s.

Every file is written in one step and is strict JSON. `null` means "not known"; a failed run has no number anywhere.
An *output* is one scalar of the response. Its id is `experiment:channel@depth`, for example `middle_point:Fz@3.9`,
with the depth in mm; in a hold it is `experiment:channel@depth+time`, as in `rest:Fz@2+5.4s`. A *curve* is a
compared channel. The first of an experiment has the name of the experiment, any other that name and its own:
`middle_point Fx`. Intervals hold 90 %."""


def page(file: str = "") -> list[str]:
    """The whole page, or the part on one file; ValueError naming the files."""
    if file and file not in RESULT_FILES:
        raise ValueError(f"there is no result file {file!r}; choose one of {', '.join(RESULT_FILES)}")
    lines = [] if file else RESULTS_PAGE_HEAD.splitlines()
    described: set[type[ResultBlock]] = set()
    for name, block in RESULT_FILES.items():
        if file in ("", name):
            lines += ["", *_tables(f"`{name}`", block, described)]
    return lines if not file else lines[1:]


def result_schema(file: str) -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of a result file; ValueError naming the files."""
    if file not in RESULT_FILES:
        raise ValueError(f"there is no result file {file!r}; choose one of {', '.join(RESULT_FILES)}")
    return {"$schema": SCHEMA_DIALECT, **RESULT_FILES[file].model_json_schema()}


def _tables(heading: str, block: type[ResultBlock], described: set[type[ResultBlock]], depth: int = 2) -> Iterator[str]:
    """A heading, what the block is, its keys, and the blocks within it; each block is described once."""
    yield from (f"{'#' * depth} {heading}", "", " ".join((block.__doc__ or "").split()), "")
    yield from ("| key | unit | content |", "|---|---|---|")
    inner: list[tuple[str, type[ResultBlock]]] = []
    for name, field in block.model_fields.items():
        key, within = f"{field.alias or name}{_form(field.annotation)}", _block(field.annotation)
        if within is not None and within not in described:
            described.add(within)
            inner.append((key, within))
        yield f"| `{key}` | {_unit(field)} | {_content(field)} |"
    outer = "" if depth == 2 else f"{heading.strip('`')}."
    for key, within in inner:
        yield ""
        yield from _tables(f"`{outer}{key}`", within, described, 3)


def _unit(field: FieldInfo) -> str:
    extra = field.json_schema_extra
    return str(extra["unit"]) if isinstance(extra, dict) and "unit" in extra else ""


def _content(field: FieldInfo) -> str:
    choices = "" if _block(field.annotation) else ", ".join(f"`{v}`" for v in _choices(field.annotation))
    text = field.description or ""
    missing = [v for v in _choices(field.annotation) if f"`{v}`" not in text]
    return f"{text}: {choices}" if missing else text


def _form(kind: Any) -> str:
    """What a key holds: `[]` a list, `{}` a table by names, as often as they are in each other."""
    origin, inside = get_origin(kind), [a for a in get_args(kind) if a not in (NoneType, Ellipsis)]
    if origin in (Union, UnionType):
        return max((_form(a) for a in inside), key=len)
    if origin is tuple:
        return f"[]{_form(inside[0])}"
    if origin is dict:
        return f"{{}}{_form(inside[1])}"
    return ""


def _block(kind: Any) -> type[ResultBlock] | None:
    if isinstance(kind, type) and get_origin(kind) is None:
        return kind if issubclass(kind, ResultBlock) else None
    return next((found for a in get_args(kind) if (found := _block(a)) is not None), None)


def _choices(kind: Any) -> list[str]:
    if get_origin(kind) is Literal:
        return [str(v) for v in get_args(kind)]
    return [v for a in get_args(kind) for v in _choices(a)]
