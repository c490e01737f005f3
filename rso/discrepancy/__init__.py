"""Where a fitted model differs from measurements, which unmodelled effect causes it, and how much of the gap it closes.

effects      the catalogue: every knob with a neutral value and a plausible range
testplan     what was measured, in bins        library     what is computed once per test plan
runs, planning   what is simulated for it      responses   and what the simulations answered
prediction   parameters → data vector          noise       what readings and models scatter by
sensor       what filters or counts in steps
mixture      exact evidence in tiles           attribute   the contest of hypotheses
localise     where                             shrinkage   how much
unfitted     what was left out of the fit      remainder   what a cause leaves
undecided    what parameters could be besides  jumps, cracks, periodic disturbance  what no smooth model has
detectable   what this plan can see            judgement   what a contest says
checks       how far to trust it               judge       the verdict
rerun        finalists recomputed           next_test   what would decide it
story        all of it as plain data           words, parameters   and in sentences
"""

from rso.discrepancy.diagnosis import Diagnosis, diagnose
from rso.discrepancy.diagnosis_results import diagnosis_data
from rso.discrepancy.evidence.detectable import announced, detectable_by_plan
from rso.discrepancy.library.effects import Effect, bounded, catalogue, localised, measured_effects, suited
from rso.discrepancy.library.planning import planned_simulations
from rso.discrepancy.library.simulations import Base, BaseAxis
from rso.discrepancy.library.tables import Library, LibraryUnanswered, build_library
from rso.discrepancy.library.test_plan import Experiment, TestPlan, make_test_plan
from rso.discrepancy.proposals import planned_tests
from rso.discrepancy.rerun import LIBRARY_TOLERANCE, RerunCheck, corrected_library, finalists, planned_rerun

__all__ = [
    "LIBRARY_TOLERANCE",
    "Base",
    "BaseAxis",
    "Diagnosis",
    "Effect",
    "Experiment",
    "Library",
    "LibraryUnanswered",
    "RerunCheck",
    "TestPlan",
    "announced",
    "bounded",
    "build_library",
    "catalogue",
    "corrected_library",
    "detectable_by_plan",
    "diagnose",
    "diagnosis_data",
    "finalists",
    "localised",
    "make_test_plan",
    "measured_effects",
    "planned_rerun",
    "planned_simulations",
    "planned_tests",
    "suited",
]
