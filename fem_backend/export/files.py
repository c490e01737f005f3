"""What the finite element model hands to other programs: names of formats, files, and what must be known of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from fem_backend.export.abaqus import abaqus_deck
from fem_backend.export.febio import LOG_FILE, febio_deck
from fem_backend.export.material_cards import NotWritten, card_constants, cards
from fem_backend.export.solid_model import N_PIECES_AROUND, SolidModel, solid_model
from fem_backend.simulation import assembly
from fem_backend.simulation.experiment import Settings
from fem_backend.simulation.knobs import Knobs
from rso.contract import Programme

EXPORT_FORMATS: Mapping[str, str] = {
    "febio": "input file of FEBio 4: mesh, material, contact, load curve, reaction forces",
    "abaqus": "the same for Abaqus and CalculiX",
    "cards": "the material as cards of Abaqus, CalculiX, ANSYS, FEBio and SOFA",
}


def exported(
    kind: str, settings: Settings, knobs: Knobs, programme: Programme, mesh: str | None, remarks: Sequence[str]
) -> dict[str, str]:
    """File → text of a format; ValueError for an unknown one, :class:`.NotWritten` for what it cannot say."""
    if kind not in EXPORT_FORMATS:
        raise ValueError(f"format {kind!r}: choose from {', '.join(EXPORT_FORMATS)}")
    if kind == "cards":
        if any(settings.specimen.laws):
            raise NotWritten("layers with a law of their own: their cards are not written")
        return cards(card_constants(assembly.material(settings, knobs)), remarks)
    asked, _ = programme.passages()
    model = solid_model(settings, knobs, (np.array(programme.time_s), np.array(programme.travel_mm)), asked, mesh)
    said = [*remarks, *export_notes(model)]
    if kind == "febio":
        where = f"{LOG_FILE} holds Fz (N) of the rigid indenter; its size is the force on it"
        return {"indentation.feb": febio_deck(model, [*said, where])}
    where = "Fz on the indenter is minus the third total force of the set TOOL"
    return {"indentation.inp": abaqus_deck(model, [*said, where])}


def export_notes(model: SolidModel) -> list[str]:
    """What a reader must know: units, the share of symmetry, and in what this model is not the one that was fitted."""
    part = {1: "the whole", 2: "a half", 4: "a quarter"}[model.share]
    gap = 100.0 * (1.0 - math.cos(math.pi / N_PIECES_AROUND))
    return [
        "units N, mm, MPa, s; z points up",
        f"{part} of the model: multiply forces by {model.share}",
        f"the indenter is meshed: its flat pieces lie inside by up to {gap:.2g} % of the distance from its axis",
        "contact is a penalty or an augmented Lagrangian of the program; the mesh is the study's in three dimensions",
    ]
