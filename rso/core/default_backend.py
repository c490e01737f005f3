"""The backend that comes with `rso`, as data: the one place that names it, and what the command line asks of it."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TypedDict, cast

BACKEND_PACKAGE = "fem_backend"
DEFAULT_BACKEND = f"{BACKEND_PACKAGE}.backend:BACKEND"  # what a new study says under [backend]
COMMAND_LINE_MODULE = f"{BACKEND_PACKAGE}.adapter.command_line"  # plain data: nothing that computes is loaded for it


class Part(TypedDict):
    """Specimen or indenter in a nominal.json, and as a setting.

    `sizes`: key → key of the setting and how many lengths (mm).  `granted`: key → what the model takes for granted and
    may be said.  `setting`: what the setting says beside its sizes.
    """

    sizes: Mapping[str, tuple[str, int]]
    granted: Mapping[str, Sequence[Any]]
    setting: Mapping[str, Any]


class SupportWords(TypedDict):
    """A kind of support: words that mean it, and its numbers, key → key of the setting and value where not stated."""

    words: tuple[str, ...]
    numbers: Mapping[str, tuple[str, float]]


class Laboratory(TypedDict):
    """What a laboratory's folder may say of an experiment (`rso blind`).

    `assumed`: the support without one, and why; `without_numbers` is why numbers `beside` the support (older key → key)
    are not used then.  `parameters`: knob → its line in the study.  `example` and `ranges` are for people.
    """

    parts: Mapping[str, Part]
    supports: Mapping[str, SupportWords]
    assumed: tuple[str, str]
    without_numbers: str
    beside: Mapping[str, str]
    parameters: Mapping[str, Mapping[str, str]]
    example: str
    ranges: str


class CommandLine(Protocol):
    """The module COMMAND_LINE_MODULE."""

    LABORATORY: Laboratory


def command_line() -> CommandLine:
    """What the command line asks of the backend."""
    return cast(CommandLine, importlib.import_module(COMMAND_LINE_MODULE))
