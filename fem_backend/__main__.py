"""python -m fem_backend request.json response.json : one simulation without rso; --schema prints what it knows."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

from fem_backend.backend import BACKEND
from rso.contract import Case, SimulationFailed


def schema() -> dict[str, Any]:
    """What a caller needs to write a request and to read a response."""
    return {
        "name": BACKEND.name,
        "numerics": BACKEND.numerics,
        "parameters": [dataclasses.asdict(p) for p in BACKEND.parameters],
        "channels": dict(BACKEND.channels),
        "request": {
            "values": {"mu": 0.01, "D1": 5.8},
            "case": {
                "name": "middle_point",
                "programme": {"time_s": [0, 8], "travel_mm": [0, 4], "asked_mm": [1, 2, 3, 4]},
                "settings": {
                    "specimen": {"shape": "ellipsoid", "semi_axes": [60, 35, 35]},
                    "indenter": {"shape": "sphere", "radius": 3},
                    "support": {"kind": "fixed"},
                    "material": {"law": "neo_hookean | linear_elastic"},
                    "point": [0, 0],
                    "mesh": {"mesher": "tetwild | mapped", "level": "coarse | standard | fine | reference"},
                },
            },
        },
        "response": {
            "status": "done | failed",
            "channels": {"time": [], "travel": [], "Fx": [], "Fy": [], "Fz": [], "uz_max": [], "bulge": []},
            "units": {},
            "error": {},
            "cause": "only if failed",
            "reason": "only if failed",
        },
    }


def answer(request: dict[str, Any]) -> dict[str, Any]:
    """Response to a request as plain data; a failure of the model is a response, misuse raises ValueError."""
    unknown = sorted(set(request) - {"values", "case"})
    if unknown or set(request) != {"values", "case"}:
        raise ValueError(f"request: exactly 'values' and 'case' are expected, got {sorted(request)}")
    if not isinstance(request["values"], dict):
        raise ValueError(f"request: 'values' must be a table of numbers, got {request['values']!r}")
    try:
        return BACKEND(request["values"], Case.from_json(request["case"])).to_json()
    except SimulationFailed as failed:
        reached = {} if failed.partial is None else failed.partial.to_json()
        return {**reached, "status": "failed", "cause": failed.cause, "reason": failed.reason,
                "history": list(failed.history)}  # fmt: skip


def main(arguments: list[str]) -> int:
    """Exit code 0 for an answer (also a failed one), 2 for a bad request."""
    if arguments == ["--schema"]:
        print(json.dumps(schema(), indent=2))
        return 0
    if len(arguments) != 2:
        print("usage: python -m fem_backend request.json response.json | --schema", file=sys.stderr)
        return 2
    try:
        request = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
        if not isinstance(request, dict):
            raise ValueError("request: a table with 'values' and 'case' is expected")
        response = answer(request)
        Path(arguments[1]).write_text(json.dumps(response, indent=1), encoding="utf-8")
    except (OSError, ValueError) as error:  # anything else is a bug and must look like one
        print(f"{arguments[0]}: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
