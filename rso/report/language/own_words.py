"""What a person has named, which no language changes: experiments, searches, candidates, files, parameters."""

from __future__ import annotations

from collections.abc import Iterator

from rso.report.layout.digits import channel_text, clean, symbol
from rso.report.reading import Results, candidates, listed, parameters, views


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
