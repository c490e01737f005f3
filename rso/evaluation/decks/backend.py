"""A program with input and result files as a backend: `Deck` says all of it, `DeckBackend` runs it."""

from __future__ import annotations

import dataclasses
import importlib.util
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rso.contract import (
    Case,
    NotFinite,
    Parameter,
    Programme,
    Response,
    SimulationFailed,
    digest,
    plain,
    run_key,
    worded,
)
from rso.contract.responses import ALWAYS_CHANNELS
from rso.core import disk
from rso.core.units import in_base
from rso.evaluation.decks.readers import DeckOutput, NotFound, at_passages, free_curve, read_output
from rso.evaluation.decks.templates import DELIMITERS, Template, read_template
from rso.evaluation.fingerprints import fingerprint_of
from rso.evaluation.guarded_process import end_of, no_program, run_guarded, tail, words_of

# of the programme: deepest travel mm, its last time s, first speed mm/s
PROGRAMME_WORDS = ("depth", "duration", "speed")
BLOCK_WORDS = ("step", "time", "travel")  # of each asked passage or corner: its number from 1, s, mm
TIMED_WORDS = {"duration", "speed", "time"}
PRINTED_FILES = ("stdout.txt", "stderr.txt")


@dataclass(frozen=True)
class Failure:
    """What in the output means that there is no answer: a regular expression, files searched, and the cause class."""

    pattern: str
    files: tuple[str, ...] = PRINTED_FILES
    cause: str = "step_limit"


@dataclass(frozen=True)
class Deck:
    """Everything that makes a backend of a program, in words that travel to another process.

    Names of files are relative to the study's folder: `templates` are filled for each run, `files` go along unchanged.
    `fingerprint` is that of all contents when the study was read: a backend that finds others is refused.  `ranges` are
    those of the parameters, within their hard bounds, over which it is tried whether all can be filled in.
    """

    templates: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    ranges: tuple[tuple[float, float], ...]
    outputs: tuple[DeckOutput, ...]
    files: tuple[str, ...] = ()
    failure: Failure | None = None
    delimiters: tuple[str, str] = DELIMITERS
    settings: tuple[str, ...] = ()
    fingerprint: str = ""


@dataclass(frozen=True)
class DeckBackend:
    """A program that reads input files made from templates and writes files that readers understand.

    Each run has a fresh folder below `keep_folder` with the filled templates and the files beside them, which is also
    the working directory of the command; it is removed after *done* and kept otherwise.  The command is run without a
    shell; after `timeout_s` it and all processes of its group are killed.

    A run is *failed* where the pattern of `failure` is in its output, and *done* where the exit code is 0 and every
    output has a value at every asked passage.  Anything else is a crash: RuntimeError with what the program said.

    `fingerprint` is the hash of templates, files, command, readers and the pattern: where one of them changes runs are
    remade.  What files the program reads elsewhere is not seen.
    """

    deck: Deck
    templates: tuple[Template, ...]
    command: tuple[str, ...]
    base: str
    fingerprint: str
    hashes: Mapping[str, str]
    keep_folder: str | None = None
    timeout_s: float | None = None
    name: str = "deck"
    numerics: int = 1

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those that the study declares."""
        return self.deck.parameters

    @property
    def channels(self) -> Mapping[str, str]:
        """Those of its outputs, time and travel."""
        return {**ALWAYS_CHANNELS, **{o.channel: o.unit for o in self.deck.outputs if not o.over}}

    def free_curves(self) -> Mapping[str, tuple[str, str, str]]:
        """Outputs over an abscissa of their own."""
        return {o.channel: (o.unit, o.over, o.over_unit) for o in self.deck.outputs if o.over}

    def check(self, case: Case) -> None:
        """ValueError for a setting that no placeholder uses, or for a deck that cannot be filled over the ranges.

        Nothing is run.
        """
        settings = _flat(case.settings)
        used = {name for t in self.templates for name in t.names}
        for name in settings:
            if name not in used and name not in PROGRAMME_WORDS:
                at = ", ".join(self.deck.templates)
                raise ValueError(f"{name} = {settings[name]!r}: no placeholder of {at} uses this setting")
        if lost := sorted(n for n in used if n in self.deck.settings and n not in settings):
            raise ValueError(f"{lost[0]}: a placeholder of the templates uses this setting, which has no value here")
        if case.programme.still and (lost := sorted(used & {*PROGRAMME_WORDS})):
            raise ValueError(f"{lost[0]}: a placeholder of the templates uses this, and nothing is moved in this study")
        for values in _ends_and_middle(self.deck):
            self.filled(values, case)

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        """Settings that no placeholder uses dropped; a deck without times answers while loading only, at any speed."""
        used = {name for t in self.templates for name in t.names}
        settings = {k: v for k, v in case.settings.items() if any(n in used for n in _flat({k: v}))}
        programme = case.programme
        if not programme.still and not used & TIMED_WORDS and all(o.at != "time" for o in self.deck.outputs):
            programme = Programme.ramp(programme.asked_mm)
        return self._checked(values), dataclasses.replace(case, settings=settings, programme=programme)

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        """No artefacts: a program makes its own meshes."""
        return {}

    def make(self, recipe: str) -> bytes:
        """Never asked for."""
        raise ValueError(f"{self.name}: a deck makes no artefacts (recipe {recipe!r})")

    def filled(self, values: Mapping[str, float], case: Case) -> Mapping[str, Sequence[tuple[int, str, bool]]]:
        """Template → its lines as they would be written, each with its line there and whether something is filled in.

        Raises ValueError naming file, line and placeholder for what cannot be filled in.
        """
        programme = case.programme
        t, u = (np.zeros(1),) * 2 if programme.still else (np.array(programme.time_s), np.array(programme.travel_mm))
        own = {"depth": 0.0, "duration": 0.0, "speed": 0.0}
        if not programme.still:
            own = {"depth": float(u.max()), "duration": float(t[-1]), "speed": float(abs(np.diff(u) / np.diff(t))[0])}
        given = {**_flat(case.settings), **own, **worded(self.parameters, self._checked(values))}
        units = {p.name: p.unit for p in self.parameters} | _units_of(case.settings) | WORD_UNITS
        rows = {"asked": _rows(*programme.passages()), "corner": _rows(t, u)}
        return {template.name: list(template.written(given, units, rows)) for template in self.templates}

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        """Run the program once; SimulationFailed if its output says so, RuntimeError for a crash."""
        key = run_key(self, *self.canonical(values, case))  # type: ignore[arg-type]  # its fields are frozen
        texts = self.filled(values, case)
        if self.keep_folder is not None:  # not when loaded: workers start before old results are moved aside
            disk.folder(Path(self.keep_folder))
        folder = Path(tempfile.mkdtemp(prefix=f"{key[:12]}-", dir=self.keep_folder))
        for name, lines in texts.items():
            data = "".join(text for _, text, _ in lines).encode("utf-8", "surrogateescape")
            _placed(folder, name).write_bytes(data)
        for name in self.deck.files:
            data = disk.read_bytes(Path(self.base) / name)
            if digest(data.hex()) != self.hashes[name]:
                raise RuntimeError(f"{name} has changed since the study was read: run it again")
            _placed(folder, name).write_bytes(data)
        code = run_guarded(self.command, folder, self.timeout_s)
        response = self._read(folder, code, case.programme)
        shutil.rmtree(folder)
        return response

    def _checked(self, values: Mapping[str, float]) -> dict[str, float]:
        known = {p.name: p for p in self.parameters}
        if unknown := sorted(set(values) - set(known)):
            raise ValueError(f"unknown parameter {', '.join(unknown)}; this deck has {', '.join(known)}")
        if missing := [name for name in known if name not in values]:
            raise ValueError(f"no value for {', '.join(missing)}")
        return {name: p.check(values[name]) for name, p in known.items()}

    def _read(self, folder: Path, code: int, programme: Programme) -> Response:
        """The response of a run that has ended, or SimulationFailed or RuntimeError."""
        said = self._failure(folder)
        try:
            response = self._response(folder, programme, partial=said is not None)
        except (NotFound, NotFinite) as error:
            if said is not None:
                assert self.deck.failure is not None
                raise SimulationFailed(self.deck.failure.cause, said) from None
            if isinstance(error, NotFinite) and code == 0:
                raise error.failure() from None
            raise self._crash(folder, code, str(error)) from None
        if said is not None:
            assert self.deck.failure is not None
            raise SimulationFailed(self.deck.failure.cause, said, response)
        if code != 0:
            raise self._crash(folder, code, "although every output was found")
        return response

    def _crash(self, folder: Path, code: int, why: str) -> RuntimeError:
        said = tail(end_of(folder / "stderr.txt")) or tail(end_of(folder / "stdout.txt"), 5)
        return RuntimeError(f"exit code {code}, {why}; see {folder}; the program ended with: {said or '(nothing)'}")

    def _failure(self, folder: Path) -> str | None:
        """The line of the output that means that there is no answer, with its file; None without any."""
        if self.deck.failure is None:
            return None
        pattern = re.compile(self.deck.failure.pattern, re.MULTILINE)
        for name in dict.fromkeys((*PRINTED_FILES, *self.deck.failure.files, *(o.file for o in self.deck.outputs))):
            try:
                text = disk.read_bytes(folder / name).decode("utf-8", "replace")
            except OSError:
                continue
            if found := pattern.search(text):
                start = text.rfind("\n", 0, found.start()) + 1
                line = text[start:].split("\n", 2)
                said = " ".join(words.strip() for words in line[: 2 if len(line[0].strip()) < 20 else 1])
                return f"{name}: {said[:300]}"
        return None

    def _response(self, folder: Path, programme: Programme, partial: bool) -> Response:
        """Channels at the asked passages, of a `partial` answer as far as all of them go; NotFound for less."""
        time, travel = programme.passages()
        values, errors, curves = {}, {}, {}
        for output in self.deck.outputs:
            found = read_output(output, folder, Path(self.base))
            if output.over:
                curves[output.channel] = free_curve(output, found)
                continue
            values[output.channel], errors[output.channel] = at_passages(output, found, programme)
        n = min([len(time), *(len(v) for v in values.values())])
        if n < len(time) and not (partial and n):
            short = next(o for o in self.deck.outputs if len(values[o.channel]) == n)
            words = f"has {short.channel} at {n} of {len(time)} asked travels, the deepest at {travel[-1]:.6g} mm"
            raise NotFound(f"{short.file}: {words}")
        channels = {"time": time[:n], "travel": travel[:n], **{k: v[:n] for k, v in values.items()}}
        stated = {k: e[:n] for k, e in errors.items() if np.any(e[:n] > 0)}
        return Response(channels, self.channels, stated, curves=curves)


WORD_UNITS = {"depth": "mm", "duration": "s", "speed": "mm/s", "time": "s", "travel": "mm"}


def load_deck(
    deck: Deck, command: Sequence[str], base: Path, keep_folder: str | None = None, timeout_s: float | None = None
) -> DeckBackend:
    """The backend of a deck whose files lie in `base`; nothing is run and no code of a study is loaded.

    Raises ValueError for a program or files that are not there, placeholders that name nothing, and parameters in none.
    """
    known = {*(p.name for p in deck.parameters), *deck.settings, *PROGRAMME_WORDS}
    if clash := sorted({p.name for p in deck.parameters} & {*PROGRAMME_WORDS, *BLOCK_WORDS, *deck.settings}):
        raise ValueError(f"parameter {clash[0]!r} has the name of a setting or of a word of the programme; rename it")
    if (why := no_program(tuple(command), base)) is not None:
        raise ValueError(why)
    for name in (*deck.templates, *deck.files):
        if Path(name).is_absolute() or ".." in Path(name).parts:
            raise ValueError(f"{name}: files of a deck lie beside the study or in folders there")
    contents = {name: _contents(base, name) for name in (*deck.templates, *deck.files)}
    hashes = {name: digest(data.hex()) for name, data in contents.items()}
    texts = [(name, contents[name].decode("utf-8", "surrogateescape")) for name in deck.templates]
    templates = [read_template(name, text, known, BLOCK_WORDS, deck.delimiters) for name, text in texts]
    used = {name for t in templates for name in t.names}
    if idle := [p.name for p in deck.parameters if p.name not in used]:
        left, right = deck.delimiters
        at = ", ".join(deck.templates)
        raise ValueError(f"parameter {idle[0]!r} stands nowhere in {at}: write {left}{idle[0]}{right} where it belongs")
    inside = {*deck.templates, *deck.files}
    words = tuple(w if w in inside else words_of((w,), base)[0] for w in command)
    named = [fingerprint_of(w) if Path(w).is_absolute() and Path(w).is_file() else w for w in words]
    readers = [_fields(o, base) for o in deck.outputs]
    failure = None if deck.failure is None else dataclasses.asdict(deck.failure)
    order = [list(deck.templates), list(deck.files)]
    fingerprint = digest(plain([hashes, order, named, readers, failure, list(deck.delimiters)]))
    if deck.fingerprint not in ("", fingerprint):
        raise ValueError(f"{', '.join(hashes)}: files of the deck have changed since the study was read: run it again")
    keep = None if keep_folder is None else str(Path(keep_folder).absolute())
    return DeckBackend(deck, tuple(templates), words, str(base), fingerprint, hashes, keep, timeout_s)


def _fields(output: DeckOutput, base: Path) -> list[Any]:
    """What an output is read by, for the fingerprint: of a function the hash of its file too."""
    fields: list[Any] = [dataclasses.asdict(output)]
    if ":" in output.reader:
        name = output.reader.partition(":")[0]
        file = base.joinpath(*name.split(".")).with_suffix(".py")
        if file.is_file():
            return [*fields, fingerprint_of(str(file))]
        try:
            found = importlib.util.find_spec(name)
        except (ImportError, ValueError):
            found = None
        if found is None:
            raise ValueError(f"reader = {output.reader!r}: there is no module {name!r}, installed or beside the study")
        if found.origin is not None and Path(found.origin).is_file():
            return [*fields, fingerprint_of(found.origin)]
    return fields


def _contents(base: Path, name: str) -> bytes:
    try:
        return disk.read_bytes(base / name)
    except FileNotFoundError:
        raise ValueError(f"{name}: there is no such file beside the study ({base})") from None
    except OSError as error:
        raise ValueError(f"{name}: {error.strerror}") from error


def _placed(folder: Path, name: str) -> Path:
    """Where a file of the deck goes in the folder of a run, whose folders are made."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _rows(time: np.ndarray, travel: np.ndarray) -> list[dict[str, float]]:
    pairs = enumerate(zip(time.tolist(), travel.tolist(), strict=True), 1)
    return [{"step": float(k), "time": t, "travel": u} for k, (t, u) in pairs]


def _flat(settings: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Settings by dotted names; texts with a unit as numbers in N, mm, MPa, s."""
    found: dict[str, Any] = {}
    for key, value in settings.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{above}{key}.")
        else:
            found[f"{above}{key}"] = _number(value)[0]
    return found


def _units_of(settings: Mapping[str, Any], above: str = "") -> dict[str, str]:
    """Units of the settings that have one, by dotted names."""
    found: dict[str, str] = {}
    for key, value in settings.items():
        if isinstance(value, Mapping):
            found |= _units_of(value, f"{above}{key}.")
        elif unit := _number(value)[1]:
            found[f"{above}{key}"] = unit
    return found


def _number(value: Any) -> tuple[Any, str]:
    """A setting, as a number where its text is one with a unit, and that unit."""
    if isinstance(value, bool):
        return int(value), ""
    if not isinstance(value, str):
        return value, ""
    try:
        return in_base(value)
    except ValueError:
        return value, ""


def _ends_and_middle(deck: Deck) -> Iterator[dict[str, float]]:
    """Values at which it is tried whether a deck can be filled: between the ends of all ranges, and at these."""
    for share in (0.5, 0.0, 1.0):
        pairs = zip(deck.parameters, deck.ranges, strict=True)
        each = ((p, low + share * (high - low)) for p, (low, high) in pairs)
        yield {p.name: float(round(v)) if p.whole or p.choices else v for p, v in each}
