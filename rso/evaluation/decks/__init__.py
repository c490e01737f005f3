"""Input files of any program as a backend: filled from a template, run in a folder of their own, read by readers.

Public names are listed here; the files behind them are private to this room.
"""

from rso.evaluation.decks.backend import Deck, DeckBackend, Failure, load_deck
from rso.evaluation.decks.readers import READERS, DeckOutput
from rso.evaluation.decks.templates import DELIMITERS, Template, read_template

__all__ = [
    "DELIMITERS",
    "READERS",
    "Deck",
    "DeckBackend",
    "DeckOutput",
    "Failure",
    "Template",
    "load_deck",
    "read_template",
]
