"""What a person has named, which no language changes: experiments, searches, candidates, files, parameters."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from rso.report.layout.digits import channel_text, clean, symbol
from rso.report.reading import Results, candidates, listed, parameters, views

NAME_KEYS = ("name", "letter", "experiment", "parameter", "effect", "channel", "file", "curve", "mounting", "focus")
NAME_LIST_KEYS = ("experiments", "channels", "added")  # lists of names
NAME_TABLE_KEYS = ("units", "before", "gain")  # tables whose keys are names


def names_of(found: Any) -> frozenset[str]:
    """Names in the data of any other command: what stands under a key that is for names, however deep."""
    own = frozenset(w for name in _named(found) for w in (clean(name), symbol(name), _ratio(name)) if w)
    return own - {clean(e.get("label")) for e in listed(found, "effects")}  # what people call an effect has a template


def _ratio(name: str) -> str:
    """A parameter that is a share of another, by the letters of both: C₂₀/μ."""
    return "".join(part if part in "/·" else symbol(part) for part in re.split("([/·])", name))


def _named(found: Any) -> Iterator[str]:
    if isinstance(found, Mapping):
        for key, value in found.items():
            keyed = (key in NAME_TABLE_KEYS and isinstance(value, Mapping)) or (
                key in NAME_LIST_KEYS and isinstance(value, list | tuple)
            )
            yield from (v for v in (value if keyed else [value] if key in NAME_KEYS else ()) if isinstance(v, str))
            yield from _named(value)
    elif isinstance(found, list | tuple):
        for value in found:
            yield from _named(value)


def own_words(results: Results) -> frozenset[str]:
    """Names that stay as they are in a report of any language."""
    return frozenset(w for w in _words(results) if w)


def _words(results: Results) -> Iterator[str]:
    study, backend, made = (results.get(k) or {} for k in ("study", "backend", "provenance"))
    yield from (clean(study.get(k)) for k in ("title", "file", "units"))
    yield from (clean(backend.get("name")), clean(made.get("backend")), clean(made.get("solver")))
    for p in parameters(results):
        yield from (p.name, p.letter, symbol(p.name))
    for q in listed(results.get("identification") or {}, "derived"):
        yield clean(q.get("letter"))
    for e in listed(results, "experiments"):
        yield from (clean(e.get("file")), clean(e.get("name")))
        for v in views(e):
            yield from (clean(v["name"]), clean(v.get("channel")))
    for s in listed(results, "searches"):
        yield clean(s["name"])
    for c in candidates(results):
        yield from (c.label, c.name)
    for o in listed(results, "outputs"):
        if "_" not in clean(o["channel"]) and clean(o["channel"])[:1] in "FMu":
            yield channel_text(o["channel"])
