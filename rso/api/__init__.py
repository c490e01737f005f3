"""What `import rso` offers: the calls behind the command line, with results as tables."""

from rso.api.models import FunctionModel, model
from rso.api.pareto import ParetoResult, ParetoStudy, pareto
from rso.api.run_result import RunResult
from rso.api.shortcuts import fit, indent
from rso.api.specimens import SpecimensResult, SpecimensStudy, specimens
from rso.api.workspace import AskedRun, Workspace, load
from rso.contract import Backend, Case, FreeCurve, Parameter, Programme, Response, SimulationFailed
from rso.study.errors import StudyError

__all__ = [
    "AskedRun",
    "Backend",
    "Case",
    "FreeCurve",
    "FunctionModel",
    "Parameter",
    "ParetoResult",
    "ParetoStudy",
    "Programme",
    "Response",
    "RunResult",
    "SimulationFailed",
    "SpecimensResult",
    "SpecimensStudy",
    "StudyError",
    "Workspace",
    "fit",
    "indent",
    "load",
    "model",
    "pareto",
    "specimens",
]
