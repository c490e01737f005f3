"""The finished page of a study: numbers and sentences, figures, HTML and PDF.  Never simulates, never fits."""

from rso.report.diagnosis import render_diagnosis
from rso.report.further import render_further
from rso.report.ladder import render_ladder
from rso.report.page import render

__all__ = ["render", "render_diagnosis", "render_further", "render_ladder"]
