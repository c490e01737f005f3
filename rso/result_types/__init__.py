"""What lies in the result files: every key once, with unit and meaning; schemas and docs/results.md are made of it."""

from rso.result_types.deformed_file import DeformedFile
from rso.result_types.diagnosis_file import DiagnosisFile
from rso.result_types.keys import ResultBlock
from rso.result_types.ladder_file import LadderFile
from rso.result_types.next_file import NextFile
from rso.result_types.objectives_file import ObjectivesFile
from rso.result_types.run_file import RunFile
from rso.result_types.specimens_file import SpecimensFile

RESULT_FILES: dict[str, type[ResultBlock]] = {
    "results.json": RunFile,
    "objectives/results.json": ObjectivesFile,
    "ladder.json": LadderFile,
    "next.json": NextFile,
    "specimens.json": SpecimensFile,
    "diagnosis.json": DiagnosisFile,
    "deformed.json": DeformedFile,
}

__all__ = [
    "RESULT_FILES",
    "DeformedFile",
    "DiagnosisFile",
    "LadderFile",
    "NextFile",
    "ObjectivesFile",
    "ResultBlock",
    "RunFile",
]
