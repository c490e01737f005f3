"""Sizes that a study states beside what the record of a test says of them: a radius in another unit moves the modulus
by powers of ten, and every curve fits as well as before."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fem_backend.indenters.indenter import INDENTERS
from fem_backend.members import length_words
from fem_backend.simulation.experiment import SETS, Settings, read_settings
from fem_backend.specimens.specimen import SPECIMENS

MAX_DEPTH_RATIO = 3.0  # depths over the radius of an indenter: nobody presses a ball or a flat end further in
MIN_DEPTH_RATIO = 1e-3  # roughness and the search of contact are as large as a depth below that
SAME_SIZE_TOLERANCE = 0.02  # of a size: what two words of one indenter differ by that was rounded
_SIZE_OF_UNIT = {"m": 1e3, "cm": 10.0, "mm": 1.0, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "nm": 1e-6}  # mm
_SIZE_NOTE = re.compile(
    r"(?:tip|probe|ball|bead|sphere|indenter|punch|colloid|kugel|stempel|indenteur)[ _-]?(radius|diameter|durchmesser)"
    r"\s*[\[(,]?\s*([a-zµμ]{0,3})\s*[\])]?\s*[:=,;]?\s+([0-9]+(?:[.,][0-9]+)?(?:e[-+]?[0-9]+)?)\s*([a-zµμ]{0,3})\b",
    re.IGNORECASE,
)
_THOUSANDS = re.compile(r"^[1-9][0-9]{0,2},[0-9]{3}$")


def doubts_of_radius(settings: Settings, depth: float, notes: Sequence[str]) -> list[str]:
    """What does not fit of the indenter's radius (mm), the deepest reading (mm) and the notes of the file."""
    radius = settings.indenter.plain().get("radius")
    if not isinstance(radius, float | int):
        return []  # a cone has none, a profile many
    own, said = f"indenter.radius = {radius:g} mm", []
    if depth > MAX_DEPTH_RATIO * radius:
        said.append(f"the deepest reading, {length_words(depth)}, is {depth / radius:.0f} times {own}")
    elif 0.0 < depth < MIN_DEPTH_RATIO * radius:
        said.append(f"{own} is {radius / depth:.0f} times the deepest reading, {length_words(depth)}")
    said = [f"{words}: are the units of both right?" for words in said]
    for note in notes:
        for found in _SIZE_NOTE.finditer(note):
            if (size := _in_mm(found)) is not None and abs(size - radius) > SAME_SIZE_TOLERANCE * radius:
                said.append(f"the file says {found[0].strip()!r}, the study {own}: which is right?")
    return said


def unstated_sizes(settings: Mapping[str, Any]) -> list[str]:
    """Sizes of specimen and indenter that settings leave to the usual ones: every curve fits under a wrong one, too."""
    said = []
    for noun in (SPECIMENS.noun, INDENTERS.noun):
        table = settings.get(noun) or {}
        member = getattr(read_settings(settings), noun)
        for key, of in SETS[noun].members[member.name].Table.model_fields.items():
            sizes = np.atleast_1d(of.default) if isinstance(of.default, float | tuple) else np.zeros(0)
            if key not in table and sizes.any():
                said.append(f"{noun}.{key} is not stated; {', '.join(f'{v:g}' for v in sizes)} mm is taken")
    return said


def _in_mm(found: re.Match[str]) -> float | None:
    """The radius (mm) of a note; None without a unit of length, of a 0, which says that nobody filled it in, and of a
    comma that may part thousands."""
    kind, before, number, behind = found.groups()
    unit = _SIZE_OF_UNIT.get(before.lower()) or _SIZE_OF_UNIT.get(behind.lower())
    if unit is None or _THOUSANDS.search(number):
        return None
    size = float(number.replace(",", ".")) * unit * (1.0 if kind.lower() == "radius" else 0.5)
    return size or None
