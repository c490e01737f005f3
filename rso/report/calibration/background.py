"""What lies behind the answer: every run with its state, and where everything came from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.core.digits import DASH, known, significant
from rso.report.layout.digits import aligned, channel_text, clean, duration, percent, shortest
from rso.report.layout.document import Block, Cell, Mark, Section, Table, Text, column, table, words
from rso.report.notes import sentences
from rso.report.reading import (
    OutputView,
    ParameterView,
    Results,
    lettered,
    listed,
    number,
    outputs,
    pair,
    parameters,
    target_output,
    views,
)

MAX_OUTPUT_COLUMNS = 4  # of the table of all runs

_EXIT_CODE_WORDS = {
    0: "done and verified",
    2: "bad study or data file",
    3: "finished, some runs failed",
    4: "the verification tolerance was not met",
    5: "a parameter that the study requires is not determined",
    6: "no candidate meets the targets and constraints",
    7: "a validation fails",
    130: "interrupted, can be resumed",
}


def runs(results: Results) -> Section:
    """Section 8: how many simulations there were, and each with its state."""
    every = listed(results, "runs")
    blocks: list[Block] = [Text(t) for t in _summary(results)]
    similarity = (results.get("design") or {}).get("similarity") or {}
    if similarity.get("proof"):
        blocks.append(_proof(results, similarity["proof"]))
    troubled = [r for r in every if r.get("state") in ("failed", "crashed")]
    if troubled:
        blocks.append(_trouble(results, troubled))
    blocks.append(_runs(results, every) if every else Text("No run has been made yet.", "missing"))
    return Section("runs", "All runs", tuple(blocks))


def _summary(results: Results) -> list[str]:
    design, c = results.get("design") or {}, results.get("counts") or {}
    said = []
    if design:
        if design.get("kind") != "none":
            text = f"The design ({clean(design.get('kind'))}) asked for {shortest(design.get('asked'))} runs"
            said.append(text + (f", and {design['held_out']} more held out." if design.get("held_out") else "."))
        if story := clean((results.get("joined") or {}).get("story")):
            said.append(f"From the store: {story}.")
        similarity = design.get("similarity") or {}
        points = [r.get("values") or {} for r in listed(results, "runs") if r.get("purpose") == "design"]
        made = len({tuple(sorted(p.items())) for p in points})
        if design.get("kind") != "none" and similarity.get("applied") and made:
            say = "points were run" if made > 1 else "point was run"
            said.append(f"Force scales exactly with the moduli, so {made} other {say} instead of its points.")
        if similarity.get("story"):
            said.append(clean(similarity["story"]).removesuffix(".") + ".")
        if design.get("kind") != "none" and similarity.get("applied") and known(similarity.get("runs_saved")):
            each = c.get("saved_by_similarity")  # a run of the design is one simulation or several
            more = f", {each} simulations" if known(each) and each != similarity["runs_saved"] else ""
            said.append(f"Exact similarity saved {similarity['runs_saved']} of all these{more}.")
    if known(c.get("fe_runs")):
        states = ", ".join(f"{c[k]} {k}" for k in ("done", "failed", "crashed") if known(c.get(k)))
        stored = f"{c.get('from_store') or 0} answers were in the store already"
        said.append(f"In all, {c['fe_runs']} simulations: {states}; {stored}.")
    return [" ".join(said)] if said else []


def _proof(results: Results, proof: list[Mapping[str, Any]]) -> Table:
    columns = [
        column(p.letter, aligned([_scaled(e.get("values") or {}, p.name, p.unit.factor) for e in proof]), p.unit.label)
        for p in parameters(results, free=True)
    ]
    columns += [
        column("run directly", aligned([number(e.get("direct")) for e in proof])),
        column("by similarity", aligned([number(e.get("similar")) for e in proof])),
        column("difference", tuple(Cell(percent(number(e.get("relative_difference")))) for e in proof)),
    ]
    return table("Similarity, checked on runs made both ways", columns, "Outputs in N, mm, MPa, s.")


def _scaled(values: Mapping[str, Any], name: str, factor: float) -> float | None:
    x = number(values.get(name))
    return None if x is None else x * factor


def _trouble(results: Results, troubled: list[Mapping[str, Any]]) -> Table:
    columns = [
        column("State", tuple(Cell(clean(r["state"]), mark="bad") for r in troubled), number=False),
        column("cause", words([clean(r.get("cause")) or DASH for r in troubled]), number=False),
        *_value_columns(results, troubled),
        column("in words", words([clean(r.get("reason")) or DASH for r in troubled]), number=False),
    ]
    note = (
        "Failed: the model itself has no answer there. Crashed: anything else, tried again next time. Neither "
        "enters the response surface."
    )
    return table("Runs without an answer", columns, note)


def _value_columns(results: Results, every: list[Mapping[str, Any]]) -> list[Any]:
    return [
        column(p.letter, aligned([_scaled(r.get("values") or {}, p.name, p.unit.factor) for r in every]), p.unit.label)
        for p in parameters(results, free=True)
    ]


def _runs(results: Results, every: list[Mapping[str, Any]]) -> Table:
    columns = [
        column("Run", words([clean(r.get("key"))[:8] for r in every], "code"), number=False),
        column("purpose", words([clean(r.get("purpose")).replace("_", " ") for r in every]), number=False),
        *_value_columns(results, every),
    ]
    for o in _shown_outputs(results):
        cells = aligned([_scaled(r.get("outputs") or {}, o.id, o.unit.factor) for r in every])
        columns.append(column(o.label, cells, o.unit.label))
    columns += [
        column("wall", aligned([number(r.get("wall_s")) for r in every], 3), "s"),
        column("state", tuple(_state(r) for r in every), number=False),
    ]
    return table(f"Every run ({len(every)})", columns, "All outputs of every run are in runs.csv.", folded=True)


def _shown_outputs(results: Results) -> list[OutputView]:
    """The targets of the main search, or the first outputs if there are none: a page has room for a few columns."""
    every = outputs(results)
    if len(every) <= MAX_OUTPUT_COLUMNS:
        return list(every.values())
    targets = {
        target_output(t)
        for search in listed(results, "searches")[:1]
        for t in search.get("targets") or ()
        if known(t.get("depth_mm"))
    }
    return ([o for o in every.values() if o.id in targets] or list(every.values()))[:MAX_OUTPUT_COLUMNS]


def _state(run: Mapping[str, Any]) -> Cell:
    state = clean(run.get("state"))
    if state in ("failed", "crashed"):
        return Cell(f"{state}: {clean(run['cause'])}" if run.get("cause") else state, mark="bad")
    return Cell(state)


def provenance(results: Results) -> Section:
    """Section 9: study, parameters, data, timings, versions and hashes."""
    blocks: list[Block] = [_parameters(results)] if listed(results, "parameters") else []
    rows = _study(results)
    if rows:
        blocks.append(_pairs("The study and the machine", rows))
    data = _data(results)
    if data:
        blocks.append(data)
    for e in listed(results, "experiments"):
        if e.get("notes"):
            blocks.append(Text(f"{clean(e['name'])}: {' '.join(sentences(e['notes']))}", "note"))
    times = {k: v for k, v in (results.get("timings") or {}).items() if known(v)}
    if times:
        names = {"total": "total", "fe_cpu": "CPU time of the simulations"}
        blocks.append(_pairs("Wall time", [(names.get(k, clean(k)), duration(v)) for k, v in times.items()]))
    made = results.get("provenance") or {}
    hashes = [("study file", made.get("study_sha256"))]
    hashes += [(k, v) for part in ("data_sha256", "artefacts") for k, v in (made.get(part) or {}).items()]
    found = [(clean(k), clean(v)) for k, v in hashes if v]
    if found:
        blocks.append(_pairs("SHA-256", found, "code"))
    return Section("provenance", "Provenance", tuple(blocks) or (Text("Nothing is known yet.", "missing"),))


def _pairs(title: str, rows: list[tuple[str, str]], mark: Mark = "") -> Table:
    columns = [
        column("", words([k for k, _ in rows]), number=False),
        column("", tuple(Cell(v, mark=mark) for _, v in rows), number=False),
    ]
    return table(title, columns)


def _parameters(results: Results) -> Table:
    views = parameters(results)
    low, high = ([shortest(x) for x in ends] for ends in _ends(views))
    state = [f"fixed at {p.show(p.fixed)}" if p.fixed is not None else "log" if p.log else "linear" for p in views]
    state = [s + _stated(p, e) for s, p, e in zip(state, views, listed(results, "parameters"), strict=True)]
    columns = [
        column("", words([p.letter for p in views]), number=False),
        column("name", words([p.name for p in views], "code"), number=False),
        column("meaning", words([p.description for p in views]), number=False),
        column("from", words(low)),
        column("to", words(high)),
        column("unit", words([p.unit.label or "1" for p in views]), number=False),
        column("scale", words(state), number=False),
    ]
    return table("Parameters", columns)


def _stated(p: ParameterView, entry: Mapping[str, Any]) -> str:
    """What the study file says of a range that the search has widened."""
    ends = entry.get("stated")
    if p.fixed is not None or not pair(ends) or (ends[0], ends[1]) == (p.low, p.high):
        return ""
    return f"; the study file says {' to '.join(shortest(float(f'{x * p.unit.factor:.10g}')) for x in ends)}"


def _ends(views: tuple[Any, ...]) -> tuple[list[float], list[float]]:
    # Ten digits: the range as it was written, without the noise of a change of unit.
    low = [float(f"{p.low * p.unit.factor:.10g}") for p in views]
    return low, [float(f"{p.high * p.unit.factor:.10g}") for p in views]


def _study(results: Results) -> list[tuple[str, str]]:
    study, backend, made = (results.get(k) or {} for k in ("study", "backend", "provenance"))
    packages = ", ".join(f"{clean(k)} {clean(v)}" for k, v in sorted((made.get("packages") or {}).items()))
    code = results.get("exit_code")
    rows = [
        ("study", clean(study.get("file"))),
        ("command", clean(made.get("command"))),
        ("root seed", clean(study.get("seed"))),
        ("units", clean(study.get("units"))),
        ("backend", f"{clean(backend.get('name'))}, numerics {clean(backend.get('numerics'))}" if backend else ""),
        ("solver", clean(made.get("solver"))),
        ("rso, Python", ", ".join(clean(made[k]) for k in ("rso", "python") if made.get(k))),
        ("packages", packages),
        ("cores, jobs", ", ".join(clean(made[k]) for k in ("cores", "jobs") if made.get(k) is not None)),
        ("started", clean(made.get("started"))),
        ("finished", clean(made.get("finished"))),
        ("exit code", "" if code is None else f"{code}: {_EXIT_CODE_WORDS.get(code, 'unknown')}"),
        ("because", lettered(results, results.get("exit_reason")) if code else ""),
    ]
    rows += [(clean(k), _settings(v)) for k, v in (backend.get("settings") or {}).items()]
    return [(k, v) for k, v in rows if v]


def _settings(value: object) -> str:
    """Settings as they are written in a study: name = value, lists in brackets, tables by name with a colon."""
    if isinstance(value, Mapping):
        tables = [f"{clean(k)}: {_settings(v)}" for k, v in value.items() if isinstance(v, Mapping)]
        single = [f"{clean(k)} = {_settings(v)}" for k, v in value.items() if not isinstance(v, Mapping)]
        return "; ".join([*([", ".join(single)] if single else []), *tables])
    if isinstance(value, list | tuple):
        return f"[{', '.join(_settings(v) for v in value)}]"
    return shortest(value) if known(value) else clean(value)


def _channel(e: Mapping[str, Any]) -> str:
    """What is compared; of a load-unload test it is said that half of it is."""
    channel, more = channel_text(e.get("channel")), []
    if e.get("kind") == "profile":
        more = ["profile"] if e.get("role") == "validate" else ["profile", "not used"]
    elif (e.get("settings") or {}).get("unload") is True:
        more = ["loading"]
    return ", ".join([channel, *more])


def _data(results: Results) -> Table | None:
    every = [v for e in listed(results, "experiments") for v in views(e)]
    if not every:
        return None
    depth = [[d for d in (e.get("measured") or {}).get("depth") or () if known(d)] for e in every]
    columns = [
        column("Experiment", words([clean(e["name"]) for e in every]), number=False),
        column("role", words([clean(e.get("role")) for e in every]), number=False),
        column("file", words([clean(e.get("file")) for e in every], "code"), number=False),
        column("channel", words([_channel(e) for e in every]), number=False),
        column("repeats", words([shortest(e.get("n_repeats")) for e in every])),
        column("points", words([str(len(d)) for d in depth])),
        column("to depth", words([significant(max(d), 2) if d else DASH for d in depth]), "mm"),
        column("settings", words([_settings(e.get("settings") or {}) for e in every]), number=False),
    ]
    return table("Data", columns)
