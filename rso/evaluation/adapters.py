"""Backends and no registry: a Python object ``"module:ATTR"``, an external command, and a program with input files."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import difflib
import functools
import importlib
import importlib.machinery
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType
from typing import Any, get_args

from rso.contract import (
    Backend,
    Case,
    Fingerprint,
    NotFinite,
    Parameter,
    Response,
    Scope,
    SimulationFailed,
    capability,
    digest,
    drop_neutral,
    finite,
    lacking,
    number,
    run_key,
    unfit,
    worded,
)
from rso.core import disk
from rso.core.default_backend import BACKEND_PACKAGE as OWN
from rso.core.default_backend import DEFAULT_BACKEND
from rso.evaluation.decks import Deck, load_deck
from rso.evaluation.fingerprints import fingerprint_of
from rso.evaluation.guarded_process import end_of, no_program, run_guarded, tail, words_of
from rso.evaluation.joint import joint

SCHEMA_TIMEOUT_S = 60.0  # for a program that loads large libraries before it answers


@dataclass(frozen=True)
class Source:
    """Where a backend comes from, in words that travel to another process: the arguments of `load_backend`."""

    use: str | None = None
    command: tuple[str, ...] | None = None
    base: str | None = None
    keep_folder: str | None = None
    timeout_s: float | None = None
    deck: Deck | None = None
    others: tuple[tuple[str, Source], ...] = ()

    @property
    def own(self) -> bool:
        """Whether nothing foreign runs when it is loaded: of this project's own backend, and of decks, only read."""
        if not all(s.own for _, s in self.others):
            return False
        return self.deck is not None or (self.use or "").partition(":")[0].partition(".")[0] == OWN

    def missing(self) -> str | None:
        """Why it cannot be loaded, as far as that can be said without its code; None if nothing shows."""
        if why := next((why for _, s in self.others if (why := s.missing()) is not None), None):
            return why
        root = Path.cwd() if self.base is None else Path(self.base).absolute()
        if self.command is not None:
            return no_program(self.command, root)
        top = (self.use or "").partition(":")[0].partition(".")[0]
        try:
            found = importlib.util.find_spec(top) or importlib.machinery.PathFinder.find_spec(top, [str(root)])
        except ValueError:  # a module of this process that came from no file
            return None
        if found is not None:
            return None
        near = difflib.get_close_matches(top, [OWN], n=1)
        return f"there is no module {top!r}, installed or beside the study{f'; did you mean {OWN!r}?' if near else ''}"

    @functools.cache  # noqa: B019  one entry per backend of the process, for as long as the process lives
    def load(self) -> Backend:
        """The backend, loaded once per process."""
        if self.others:
            # its name cannot be set, as in load_backend
            first = dataclasses.replace(self, others=()).load()
            return joint(first, {name: s.load() for name, s in self.others})  # type: ignore[return-value]
        if self.deck is not None:
            assert self.command is not None
            root = Path.cwd() if self.base is None else Path(self.base).absolute()
            # its name cannot be set, as in load_backend
            return load_deck(self.deck, self.command, root, self.keep_folder, self.timeout_s)  # type: ignore[return-value]
        return load_backend(
            self.use, self.command, base=self.base, keep_folder=self.keep_folder, timeout_s=self.timeout_s
        )


def load_backend(
    use: str | None = None,
    command: Sequence[str] | None = None,
    *,
    base: str | os.PathLike[str] | None = None,
    keep_folder: str | os.PathLike[str] | None = None,
    timeout_s: float | None = None,
) -> Backend:
    """Load a backend: either the object that ``use = "module:ATTR"`` names, or an external `command`.

    `base` is the folder that relative names refer to (the study's): a module may lie in it, and arguments of the
    command that name an existing file in it are made absolute.  `keep_folder` and `timeout_s` (wall, s) are for the
    command only: see :class:`CommandBackend`.

    What is not the project's own has the hash of its files as `fingerprint`, a part of every run key: of an object the
    file of its module (unless it has a `fingerprint` itself), of a command its words and the files that they name, each
    with the Python modules beside it that it imports (:func:`rso.evaluation.fingerprints.fingerprint_of`).  Data files
    that they read are not seen.

    Raises ValueError if not exactly one of the two is given, if the module, attribute or program does not exist,
    or if what was found is no backend (listing what it lacks).
    """
    if (use is None) == (command is None):
        raise ValueError(f"backend: give either use or command, got use = {use!r} and command = {command!r}")
    if command is not None:
        # name and numerics of the protocol could be set, those of a frozen dataclass cannot, and nobody does
        return _load_command(tuple(command), base, keep_folder, timeout_s)  # type: ignore[return-value]
    assert use is not None
    return _load_object(use, base)


def _load_object(use: str, base: str | os.PathLike[str] | None) -> Backend:
    module_name, _, attribute = use.partition(":")
    if not module_name or not attribute:
        raise ValueError(f'backend: use = {use!r} must read "module:ATTRIBUTE", e.g. "{DEFAULT_BACKEND}"')
    try:
        # Only where it is needed: nothing else may be imported from a study's folder by accident.
        elsewhere = importlib.util.find_spec(module_name.partition(".")[0]) is not None
        if base is not None and not elsewhere and str(Path(base).absolute()) not in sys.path:
            sys.path.append(str(Path(base).absolute()))
        module = importlib.import_module(module_name)
    except ImportError as error:
        raise ValueError(f"backend: cannot import module {module_name!r} of use = {use!r}: {error}") from error
    except (Exception, SystemExit) as error:  # its own code, whatever that does
        what = f"{type(error).__name__}: {error}"
        raise ValueError(f"backend: module {module_name!r} of use = {use!r} cannot be imported: {what}") from error
    if not hasattr(module, attribute):
        near = difflib.get_close_matches(attribute, [n for n in vars(module) if not n.startswith("_")], n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        said = f"module {module_name!r} ({module.__file__}) has no {attribute!r} (use = {use!r}){hint}"
        raise ValueError(f"backend: {said}")
    backend = getattr(module, attribute)
    missing = lacking(backend, Backend)
    if missing or isinstance(backend, type):
        lack = f"lacks {', '.join(missing)}" if missing else "is a class; an instance is needed"
        if isinstance(backend, FunctionType):
            lack = "is a plain function; @rso.model(parameters={…}) above it makes it one"
        raise ValueError(f"backend: {use!r} is not a backend (rso.contract.Backend): it {lack}")
    if wrong := unfit(backend):
        raise ValueError(f"backend: {use!r}: {'; '.join(wrong)}")
    if module_name.partition(".")[0] != OWN and capability(backend, Fingerprint) is None:
        backend = _marked(backend, use, module.__file__)
    return backend


def _marked(backend: Any, use: str, file: str | None) -> Any:
    """A copy of a foreign object with its `fingerprint`; ValueError if it takes no attribute."""
    try:
        found = copy.copy(backend)
    except TypeError:  # a module, or what holds one process's own things
        found = backend
    try:  # past the freezing of a dataclass: what it computes is not changed
        object.__setattr__(found, "fingerprint", "" if file is None else fingerprint_of(file))
    except (AttributeError, TypeError) as error:
        raise ValueError(
            f"backend: {use!r} takes no attribute; let it have one, fingerprint, that changes with its answers"
        ) from error
    return found


def check_values(parameters: tuple[Parameter, ...], values: Mapping[str, float]) -> dict[str, float]:
    """Every parameter with its value or default; ValueError for unknown, missing and out-of-bounds values."""
    known = {p.name: p for p in parameters}
    unknown = sorted(set(values) - set(known))
    if unknown:
        raise ValueError(f"unknown parameter {', '.join(unknown)}; this backend has {', '.join(known)}")
    missing = [p.name for p in parameters if p.name not in values and p.default is None]
    if missing:
        raise ValueError(f"no value for {', '.join(missing)}, which have no default")
    given = {p.name: p.check(values[p.name]) for p in parameters if p.name in values}
    return {p.name: given.get(p.name, p.default) for p in parameters}  # type: ignore[misc]


@dataclass(frozen=True)
class CommandBackend:
    """An external program as a backend: ``command request.json response.json``, no shell.

    *Schema.* ``command --schema`` prints ``{"name": str, "numerics": int, "parameters": [{"name", "description",
    "unit", "low", "high"[, "default", "neutral", "group", "typical", "scope"]}], "channels": {name: unit}[,
    "controls_force": bool]}``; other keys are ignored.  Without `controls_force` a programme that a force controls is
    refused.

    *Request.* ``{"values": {name: number}, "case": …}`` with every declared parameter (effects at their neutral
    value included) and :meth:`rso.contract.Case.to_json`.

    *Response.* ``{"status": "done", "channels", "units"[, "error", "gradients", "info"]}`` as in
    :meth:`rso.contract.Response.from_json`, or ``{"status": "failed", "cause", "reason"[, "channels", "units",
    "history"]}`` with a cause of `rso.contract.CAUSES`.  *done* needs exit code 0.  Anything else is a crash:
    RuntimeError with the end of stderr.  A value that is no number (Python's JSON words for NaN and infinity) fails.

    Each run has a fresh folder below `keep_folder` (made where it is missing; the system's folder for temporary files
    if None), which is also its working directory; it is removed after *done* and kept otherwise.  After `timeout_s` the
    program and all processes of its group are killed, and so they are when this process dies.

    *Assumptions.* The program ignores no setting silently: `check` cannot know its settings.
    """

    command: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    channels: Mapping[str, str]
    name: str
    numerics: int
    keep_folder: str | None = None
    timeout_s: float | None = None
    fingerprint: str = ""
    forced: bool = False

    def controls_force(self, settings: Mapping[str, Any]) -> bool:
        """What its schema says."""
        return self.forced

    def check(self, case: Case) -> None:
        """Nothing to say before the program runs."""

    def canonical(self, values: Mapping[str, float], case: Case) -> tuple[dict[str, float], Case]:
        """Defaults filled in, effects at neutral dropped."""
        return drop_neutral(self.parameters, check_values(self.parameters, values)), case

    def recipes(self, values: Mapping[str, float], case: Case) -> Mapping[str, str]:
        """No artefacts: a program makes its own meshes."""
        return {}

    def make(self, recipe: str) -> bytes:
        """Never asked for."""
        raise ValueError(f"{self.name}: a command makes no artefacts (recipe {recipe!r})")

    def __call__(self, values: Mapping[str, float], case: Case) -> Response:
        """Run the program once; SimulationFailed if it says so, RuntimeError for a crash."""
        filled = check_values(self.parameters, values)
        key = run_key(self, *self.canonical(values, case))  # type: ignore[arg-type]  # as in load_backend
        if self.keep_folder is not None:  # not when loaded: workers start before old results are moved aside
            disk.folder(Path(self.keep_folder))
        folder = Path(tempfile.mkdtemp(prefix=f"{key[:12]}-", dir=self.keep_folder))
        request, answer = folder / "request.json", folder / "response.json"
        request.write_text(
            json.dumps({"values": worded(self.parameters, filled), "case": case.to_json()}, allow_nan=False, indent=1)
        )
        code = run_guarded((*self.command, str(request), str(answer)), folder, self.timeout_s)
        response = _read_answer(answer, code, [p.name for p in self.parameters])
        shutil.rmtree(folder)
        return response


def _load_command(
    command: tuple[str, ...],
    base: str | os.PathLike[str] | None,
    keep_folder: str | os.PathLike[str] | None,
    timeout_s: float | None,
) -> CommandBackend:
    root = Path.cwd() if base is None else Path(base).absolute()
    words = words_of(command, root)
    if (why := no_program(command, root)) is not None:
        raise ValueError(f"backend: {why}")
    try:
        done = subprocess.run(
            (*words, "--schema"), capture_output=True, text=True, timeout=SCHEMA_TIMEOUT_S, stdin=subprocess.DEVNULL
        )
        schema = _printed(done.stdout)
        parameters = tuple(_parameter(p) for p in schema["parameters"])
        names = [p.name for p in parameters]
        if twice := sorted({n for n in names if names.count(n) > 1}):
            raise ValueError(f"parameter {twice[0]!r} is there twice")
        channels = {str(name): str(unit) for name, unit in schema["channels"].items()}
        name, numerics = str(schema["name"]), int(schema["numerics"])
        forced = schema.get("controls_force", False) is True
    except subprocess.TimeoutExpired as error:
        raise ValueError(f"backend: {' '.join(words)} --schema gave no answer in {SCHEMA_TIMEOUT_S:g} s") from error
    except (json.JSONDecodeError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(
            f"backend: {' '.join(words)} --schema must print JSON with name, numerics, parameters and channels "
            f"({type(error).__name__}: {error}; exit code {done.returncode}): {tail(done.stderr or done.stdout)}"
        ) from error
    except ValueError as error:
        raise ValueError(f"backend: {' '.join(words)} --schema: {error}") from error
    keep_folder = None if keep_folder is None else str(Path(keep_folder).absolute())
    named = [fingerprint_of(word) if os.path.isabs(word) and os.path.isfile(word) else word for word in words]
    fingerprint = "" if words[1:] == ("-m", OWN) else digest(named)
    return CommandBackend(words, parameters, channels, name, numerics, keep_folder, timeout_s, fingerprint, forced)


def _printed(text: str) -> Any:
    """The JSON that a command printed; what it printed before or behind (a banner, a licence) is passed over.

    That is the object with most keys of a schema among those that begin a line; JSONDecodeError without any.
    """
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        found = []
        for start in re.finditer(r"^[ \t]*(?=\{)", text, re.MULTILINE):
            with contextlib.suppress(json.JSONDecodeError):
                found.append(json.JSONDecoder().raw_decode(text, start.end()))
        if not found:
            raise error
        return max(found, key=lambda pair: len(pair[0].keys() & {"name", "numerics", "parameters", "channels"}))[0]


def _parameter(data: Mapping[str, Any]) -> Parameter:
    """A knob of a schema; ValueError naming it, the key and the value for what is of another type or out of order."""
    fields = [f.name for f in dataclasses.fields(Parameter)]
    if unknown := sorted(set(data) - set(fields)):
        raise KeyError(f"parameter {data.get('name')!r} has unknown {unknown}; known are {fields}")
    name, given = data["name"], {k: v for k, v in data.items() if v is not None}
    of = f"parameter {name!r}: "
    for key in {"name", "description", "unit", "group", "scope", "cause", "label"} & given.keys():
        if not isinstance(given[key], str) or (key == "name" and not name):
            raise ValueError(f"{of}{key} = {given[key]!r}: text is expected")
    for key in {"low", "high", "default", "neutral", "typical"} & given.keys():
        given[key] = _finite(f"{of}{key}", given[key])
    if "plausible" in given:
        ends = given["plausible"]
        if not isinstance(ends, list) or len(ends) != 2:
            raise ValueError(f"{of}plausible = {ends!r}: two numbers are expected, from low to high")
        given["plausible"] = tuple(_finite(f"{of}plausible", v) for v in ends)
    found = Parameter(**given)
    _in_order(found)
    return found


def _finite(name: str, value: Any) -> float:
    if not finite(value):
        raise ValueError(f"{name} = {repr(value)[:20]}: a finite number is expected")
    return number(name, value)


def _in_order(p: Parameter) -> None:
    """low < high, default, neutral and plausible range within, a scope that there is; else ValueError."""
    of = f"parameter {p.name!r}: "
    if p.low >= p.high:
        raise ValueError(f"{of}low = {p.low:g} must be below high = {p.high:g} {p.unit}")
    for key in ("default", "neutral"):
        value = getattr(p, key)
        if value is not None and not p.low <= value <= p.high:
            raise ValueError(f"{of}{key} = {value:g} is outside [{p.low:g}, {p.high:g}] {p.unit}")
    if p.plausible is not None and not p.plausible[0] < p.plausible[1]:
        raise ValueError(f"{of}plausible = {list(p.plausible)}: two numbers are expected, from low to high")
    if p.scope not in get_args(Scope):
        raise ValueError(f"{of}scope = {p.scope!r}: choose from {', '.join(get_args(Scope))}")


def _read_answer(answer: Path, code: int, knobs: Sequence[str]) -> Response:
    """The response in the file, or SimulationFailed if it says so, or RuntimeError if it is none."""

    def crash(why: object) -> RuntimeError:
        stderr = tail(end_of(answer.parent / "stderr.txt"))
        return RuntimeError(f"exit code {code}, {why}; see {answer.parent}; stderr ends with: {stderr or '(nothing)'}")

    try:
        text = disk.read_bytes(answer).decode("utf-8-sig")
    except FileNotFoundError:
        raise crash("no response file") from None
    except (OSError, ValueError) as error:
        raise crash(f"response file cannot be read ({error})") from None
    try:
        data = json.loads(text)
        if data["status"] == "failed":
            partial = _finite_part(data) if data.get("channels") else None
            failure = SimulationFailed(data["cause"], data["reason"], partial, tuple(data.get("history") or ()))
        elif data["status"] != "done":
            raise ValueError(f"status = {data['status']!r}, must be done or failed")
        elif code != 0:
            raise ValueError("although status = done")
        else:
            return _with_known_gradients(Response.from_json(data), knobs)
    except NotFinite as error:
        failure = error.failure()
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise crash(f"response file not understood ({type(error).__name__}: {error})") from error
    raise failure


def _finite_part(data: Mapping[str, Any]) -> Response | None:
    """How far a failed run came, without what is no number."""
    try:
        return Response.from_json(data)
    except NotFinite as error:
        return error.partial


def _with_known_gradients(response: Response, knobs: Sequence[str]) -> Response:
    """The response, whose derivatives are those of its channels by declared knobs; else ValueError."""
    for knob, by_channel in response.gradients.items():
        if knob not in knobs:
            raise ValueError(f"response: gradients by {knob!r}, which is none of the knobs {', '.join(knobs)}")
        if strange := sorted(set(by_channel) - set(response.channels)):
            raise ValueError(f"response: gradient of {strange[0]!r} by {knob!r}: there is no such channel")
    return response
