"""Reports in another language: sentences as templates by topic, in TOML files of a folder for each language."""

from rso.report.language.catalogue import Catalogue, languages, sentences_of
from rso.report.language.document import in_language
from rso.report.language.figure import figure_in_language
from rso.report.language.own_words import names_of, own_words
from rso.report.language.pages import PageOptions, write_page

__all__ = [
    "Catalogue",
    "PageOptions",
    "figure_in_language",
    "in_language",
    "languages",
    "names_of",
    "own_words",
    "sentences_of",
    "write_page",
]
