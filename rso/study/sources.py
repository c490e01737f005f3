"""Where the backend of a study comes from."""

from __future__ import annotations

import contextlib
import dataclasses

from rso.contract import Backend
from rso.evaluation import Source
from rso.evaluation.decks import load_deck
from rso.study.errors import Problem, study_error
from rso.study.schema import Study


def needs_data(study: Study) -> None:
    """StudyError for a study that has objectives in place of measurements."""
    if study.objectives is not None:
        text = "a study with objectives has no measurements: rso check and rso run take it, from Python rso.pareto"
        raise study_error(study.file, study.lines, [Problem(("objectives",), text)])


def backend_of(study: Study, source: Source) -> Backend:
    """The backend of a study; StudyError at the key that names what cannot be loaded."""
    try:
        return source.load()
    except ValueError as error:
        place = ("backend", "use") if study.backend.use and not study.backends else ("backend",)
        said = str(error).removeprefix("backend: ")
        raise study_error(study.file, study.lines, [Problem(place, said)]) from error


def source_of(study: Study) -> Source:
    """Where the backend of a study comes from; nothing of it is loaded."""
    b, deck = study.backend, study.deck()
    if deck is not None:
        with contextlib.suppress(ValueError):  # what is wrong is said when it is loaded
            deck = dataclasses.replace(deck, fingerprint=load_deck(deck, b.command or (), study.folder).fingerprint)
    folder = str(study.folder)
    others = ((name, Source(o.use, o.command, folder, None, o.timeout)) for name, o in study.backends.items())
    return Source(b.use, b.command, folder, None, b.timeout, deck, tuple(others))
