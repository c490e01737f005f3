"""Figures of a report as files of their own: SVG, PDF, PNG."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from rso.core import disk
from rso.report.calibration.figures import draw
from rso.report.calibration.numbers import report
from rso.report.layout.document import Picture
from rso.report.layout.page import has_pdf
from rso.report.pareto import figures as pareto_figures
from rso.report.pareto import report as pareto_report

PICTURE_SUFFIXES = (".svg", ".pdf", ".png")
PNG_DPI = 300.0  # dots per inch of a PNG


def captions(results: Mapping[str, Any]) -> dict[str, str]:
    """Name → first sentence of the caption of every figure that the report of these results has."""
    made = pareto_report.report(results) if results.get("kind") == "pareto" else report(results)
    blocks = [b for s in made.sections for b in s.blocks if isinstance(b, Picture)]
    return {b.name: re.split(r"(?<=\.) ", b.caption)[0] for b in blocks}


def every(results: Mapping[str, Any]) -> dict[str, bytes | str]:
    """File name → content of all figures: SVG and, where typst is installed, PDF."""
    drawn = {name: draw(results, name) for name in captions(results)}
    files: dict[str, bytes | str] = {f"{name}.svg": svg for name, svg in drawn.items()}
    return files | ({f"{name}.pdf": converted(svg, ".pdf") for name, svg in drawn.items()} if has_pdf() else {})


def written(results: Mapping[str, Any], name: str, file: Path) -> Path:
    """Write a figure in the format of the file's ending; ValueError for another ending."""
    if file.suffix.lower() not in PICTURE_SUFFIXES:
        raise ValueError(f"{file}: a figure is written as {', '.join(PICTURE_SUFFIXES)}")
    drawn = pareto_figures.draw(results, name) if results.get("kind") == "pareto" else draw(results, name)
    return disk.replace(file, converted(drawn, file.suffix.lower()))


def converted(svg: str, suffix: str) -> bytes | str:
    """An SVG as it is, or as PDF or PNG, its size unchanged; ValueError where typst is not installed."""
    if suffix == ".svg":
        return svg
    if not has_pdf():
        raise ValueError(f"a figure as {suffix} needs typst: pip install 'rso[pdf]'; as .svg it needs nothing")
    import typst

    page = '#set page(width: auto, height: auto, margin: 0pt)\n#image(bytes(sys.inputs.svg), format: "svg")'
    kind: Literal["pdf", "png"] = "pdf" if suffix == ".pdf" else "png"
    return typst.compile(page.encode(), format=kind, ppi=PNG_DPI, sys_inputs={"svg": svg})
