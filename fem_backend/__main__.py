"""python -m fem_backend request.json response.json : one simulation without rso.

--vtu FOLDER        one VTU file per asked instant
--pictures FOLDER   sections and the surface from above as PNG per asked instant, no display needed
--schema            what requests and responses hold, every knob with unit and range
--compile           compile now what a first simulation would have to wait for
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import sys
from pathlib import Path
from typing import Any

from fem_backend import output
from fem_backend.backend import BACKEND
from fem_backend.simulation import experiment
from fem_backend.specimens import SPECIMENS
from rso.contract import CAUSES, Case, SimulationFailed
from rso.contract.segments import CONTROLS


def request_schema() -> dict[str, Any]:
    """What a caller needs to write a request and to read a response."""
    return {
        "name": BACKEND.name,
        "numerics": BACKEND.numerics,
        "parameters": [dataclasses.asdict(p) for p in BACKEND.parameters],
        "channels": dict(BACKEND.channels),
        "controls_force": True,
        "request": {
            "values": {"mu": 0.01, "D1": 5.8},
            "case": {
                "name": "middle_point",
                "programme": {
                    "time_s": [0, 8, 16],
                    "travel_mm": [0, 4, 0],
                    "asked_mm": [1, 2, 3, 4],
                    "asked_s": [12],
                },
                "settings": experiment.choices(),
            },
        },
        "programme": {
            "by waypoints": "time_s, travel_mm; asked_mm, asked_s, asked_N",
            "by segments": {
                "segments": [
                    {"control": "travel", "rate": 0.5, "to_N": 0.01},
                    {"control": "force", "rate": 0.02, "to_N": 0.1},
                    {"control": "force", "hold_s": 60, "asked_s": [1, 10, 60]},
                    {"control": "travel", "rate": 0.5, "to_mm": 0},
                ],
                "asked_mm": [],
                "asked_N": [0.05, 0.1],
                "asked_s": [],
            },
            "control": f"{' | '.join(f'{k} ({unit})' for k, unit in CONTROLS.items())}",
            "rate": "of what is controlled, per s, positive",
            "to_mm | to_N | hold_s": "where a segment ends, or how long it rests; one of control = force ends at to_N",
            "asked_s of a segment": "moments since it began; asked_s of a programme count from its start",
        },
        "response": {
            "status": "done | failed",
            "channels": {name: [] for name in BACKEND.channels},
            "units": {},
            "error": "estimated numerical error, by channel",
            "gradients": "d(channel)/d(material knob), by knob and channel; only for materials without memory",
            "info": {},
            "cause": f"only if failed: {' | '.join(CAUSES)}",
            "reason": "only if failed",
            "history": "only if failed: relative residuals of the last step",
        },
    }


def response_to(request: dict[str, Any], vtu: Path | None = None, pictures: Path | None = None) -> dict[str, Any]:
    """Response to a request as plain data; a failure of the model is a response, misuse raises ValueError."""
    if set(request) != {"values", "case"}:
        raise ValueError(f"request: exactly 'values' and 'case' are expected, got {sorted(request)}")
    if not isinstance(request["values"], dict):
        raise ValueError(f"request: 'values' must be a table of numbers, got {request['values']!r}")
    try:
        solved = BACKEND.solve(request["values"], Case.from_json(request["case"]))
    except SimulationFailed as failed:
        reached = {} if failed.partial is None else failed.partial.to_json()
        return {
            **reached,
            "status": "failed",
            "cause": failed.cause,
            "reason": failed.reason,
            "history": list(failed.history),
        }
    if vtu is not None:
        output.write_files(solved, vtu)
    if pictures is not None:
        output.draw_pictures(solved, pictures)
    return BACKEND.response(solved).to_json()


def _read(file: Path) -> Any:
    """What a file of JSON holds; ValueError where it is none that can be read."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except RecursionError as error:
        raise ValueError("request: brackets are nested too deeply") from error


def compile_kernels() -> None:
    """Solve a body of revolution and one in space: what they need is then kept beside the code for every process."""
    ready = [
        m.Table() for m in SPECIMENS.members.values() if not any(f.is_required() for f in m.Table.model_fields.values())
    ]
    round_one = next(t for t in ready if t.build().of_revolution)
    mapped = {"mesh": {"mesher": "mapped", "n": 6, "slip": 0.3}}
    for settings in ({"specimen": round_one.build().plain()}, mapped):
        programme = {"time_s": [0, 1], "travel_mm": [0, 1], "asked_mm": [1]}
        response_to(
            {"values": {"mu": 0.01, "D1": 5.8}, "case": {"name": "any", "programme": programme, "settings": settings}}
        )


def _writable(response: Path, folders: list[Path]) -> None:
    """OSError before anything is solved where an answer would have no place."""
    if not response.parent.is_dir():
        raise FileNotFoundError(f"{response}: there is no folder {response.parent}")
    if response.is_dir():
        raise IsADirectoryError(f"{response}: a folder; the response needs the name of a file")
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)


def main(arguments: list[str]) -> int:
    """Exit code 0 for an answer (also a failed one), 2 for a bad request."""
    parser = argparse.ArgumentParser(prog="python -m fem_backend", description=__doc__.splitlines()[0])
    parser.add_argument("request", type=Path, nargs="?", help="request.json")
    parser.add_argument("response", type=Path, nargs="?", help="where the answer goes")
    parser.add_argument("--vtu", type=Path, metavar="FOLDER", help="write a VTU file per asked instant")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="draw sections and the surface")
    parser.add_argument("--schema", action="store_true", help="print what requests and responses hold")
    parser.add_argument("--compile", action="store_true", help="compile what a first simulation would wait for")
    try:
        options = parser.parse_args(arguments)
    except SystemExit as end:
        return int(end.code or 0)
    if options.schema:
        try:
            print(json.dumps(request_schema(), indent=2), flush=True)
        except BrokenPipeError:  # whoever reads has read enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    if options.compile:
        compile_kernels()
        return 0
    if options.response is None:
        parser.print_usage(sys.stderr)
        return 2
    try:
        request = _read(options.request)
        if not isinstance(request, dict):
            raise ValueError("request: a table with 'values' and 'case' is expected")
        _writable(options.response, [f for f in (options.vtu, options.pictures) if f is not None])
        response = response_to(request, options.vtu, options.pictures)
        options.response.write_text(json.dumps(response, indent=1), encoding="utf-8")
    except (OSError, ValueError) as error:  # anything else is a bug and must look like one
        print(f"{options.request}: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
