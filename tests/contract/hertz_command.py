"""The Hertz backend as an external program: ``python hertz_command.py request.json response.json``."""

import dataclasses
import json
import sys
from pathlib import Path

from hertz_backend import BACKEND

from rso.contract import Case, SimulationFailed

if sys.argv[1] == "--schema":
    parameters = [dataclasses.asdict(p) for p in BACKEND.parameters]
    schema = {"name": "hertz command", "numerics": 1, "parameters": parameters, "channels": dict(BACKEND.channels)}
    print(json.dumps(schema))
    sys.exit()
request = json.loads(Path(sys.argv[1]).read_text())
try:
    answer = BACKEND(request["values"], Case.from_json(request["case"])).to_json()
except SimulationFailed as failure:
    answer = {"status": "failed", "cause": failure.cause, "reason": failure.reason}
Path(sys.argv[2]).write_text(json.dumps(answer))
