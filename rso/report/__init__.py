"""The finished page of a study: numbers and sentences, figures, HTML and PDF.  Never simulates, never fits."""

from rso.report.calibration.report import render
from rso.report.discrepancy.report import render_diagnosis
from rso.report.model_selection.report import render_ladder
from rso.report.optimal_design.report import render_next
from rso.report.pareto.report import render_pareto
from rso.report.population.report import render_specimens

__all__ = ["render", "render_diagnosis", "render_ladder", "render_next", "render_pareto", "render_specimens"]
