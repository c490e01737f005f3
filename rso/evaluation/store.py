"""The runs of one study: content-addressed, one writer, safe against ``kill -9`` at any moment.

One folder holds ``runs.sqlite`` (write-ahead log, one transaction per run), ``objects/ab/<sha256>`` (meshes and
other artefacts) and ``runs.lock`` (who writes).  A run is stored once as *done* or *failed* and never changed;
a *crashed* run is noted apart and has no result, so that it is tried again.  Responses are zlib-compressed JSON
of :meth:`rso.contract.Response.to_json`: Python prints the shortest decimal that reads back to the same double,
so the bits survive, and any language can read them.  Each row carries the SHA-256 of its key and content, so that an
answer that stands in another run's row is found; rows of older versions have none.

The folder may come from a stranger: nothing is written through a link or into a file with a second name, a database
that holds more than these tables (views and triggers compute) is refused, and what a row unpacks to is limited.

With ``synchronous=NORMAL`` a committed run survives the death of the process; a power cut may lose the last
commits but not what was stored before.  The folder must lie on a local disk (write-ahead logs need shared memory).
"""

from __future__ import annotations

import dataclasses
import fcntl
import hashlib
import json
import os
import sqlite3
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, Self

from rso.contract import Case, Response, finite, object_path, plain
from rso.core import disk

STORE_SCHEMA = 1  # of the tables below; raised when they change
LOCK_TIMEOUT_S = 3.0  # for a worker of a killed process that still holds the lock as it starts
MAX_RESPONSE_BYTES = 64 * 1024 * 1024  # bytes that a response may unpack to: a million readings of three channels

_TABLE_STATEMENTS = (
    """CREATE TABLE runs (
        key TEXT PRIMARY KEY, state TEXT NOT NULL CHECK (state IN ('done', 'failed')), name TEXT NOT NULL,
        "values" TEXT NOT NULL, "case" TEXT NOT NULL, response BLOB, cause TEXT, reason TEXT, history TEXT,
        partial BLOB, wall_s REAL NOT NULL, cpu_s REAL NOT NULL, created TEXT NOT NULL, attempts INTEGER NOT NULL,
        checksum TEXT)""",
    """CREATE TABLE crashes (
        key TEXT NOT NULL, "when" TEXT NOT NULL, reason TEXT NOT NULL, attempt INTEGER NOT NULL,
        name TEXT NOT NULL, "values" TEXT NOT NULL)""",
    "CREATE INDEX crashes_key ON crashes (key)",
    """CREATE TABLE artefacts (
        recipe_hash TEXT PRIMARY KEY, recipe TEXT NOT NULL, name TEXT NOT NULL, sha TEXT NOT NULL)""",
    f"PRAGMA user_version = {STORE_SCHEMA}",
)
_SCHEMA_PARTS = {("table", "runs"), ("table", "crashes"), ("table", "artefacts"), ("index", "crashes_key")}
_N_SUMMED_COLUMNS = 13  # columns of a run that its checksum is taken over: all but the number of attempts and itself


class StoreError(Exception):
    """The store cannot be used; the message names the file and says what to do."""


@dataclass(frozen=True)
class Done:
    """A run with an answer."""

    key: str
    values: Mapping[str, float]
    case: Case
    response: Response
    wall_s: float
    cpu_s: float


@dataclass(frozen=True)
class Failed:
    """A run of which the backend says that there is no answer: a result, kept, never turned into a number."""

    key: str
    values: Mapping[str, float]
    case: Case
    cause: str
    reason: str
    partial: Response | None = None
    history: tuple[Mapping[str, Any], ...] = ()
    wall_s: float = 0.0
    cpu_s: float = 0.0


@dataclass(frozen=True)
class Crashed:
    """A run that ended in any other way: not a result, tried again next time.

    The first line of `reason` is one sentence; a traceback may follow.
    """

    key: str
    values: Mapping[str, float]
    case: Case
    reason: str
    attempts: int = 1


@dataclass(frozen=True)
class Row:
    """One line of the list of runs; `cause` and `reason` are None for a run that is done."""

    key: str
    state: Literal["done", "failed", "crashed"]
    name: str
    values: Mapping[str, float]
    cause: str | None
    reason: str | None
    wall_s: float | None
    cpu_s: float | None
    created: str
    attempts: int


class RunStore:
    """The store of one study folder, used as ``with RunStore(folder) as store``.

    One process at a time may write; any number may read with ``read_only=True`` meanwhile.
    Every method raises StoreError when the file is damaged, foreign, locked, not writable or the disk is full.
    """

    def __init__(self, folder: str | os.PathLike[str], *, read_only: bool = False) -> None:
        self.folder = Path(folder).absolute()
        self.objects = self.folder / "objects"
        self.read_only = read_only
        self._file = self.folder / "runs.sqlite"
        self._lock: int | None = None
        self._db: sqlite3.Connection | None = None

    def __enter__(self) -> Self:
        try:
            with _explained(self._file):
                for end in ("", "-wal", "-shm", "-journal"):
                    disk.only(self._file.with_name(self._file.name + end))
                if self.read_only:
                    self._db = _connect_to_read(self._file)
                else:
                    disk.folder(self.objects)
                    self._lock = _lock(self.folder / "runs.lock")
                    for left_over in self.objects.glob("tmp-*"):  # we hold the lock: whoever wrote it is dead
                        left_over.unlink()
                    for folder in (self.folder, *self.objects.iterdir()):
                        disk.without_leftovers(folder)
                    self._db = _connect_to_write(self._file)
                _check_schema(self._db, self._file)
                if not self.read_only:
                    _with_checksums(self._db)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if self._db is not None:
            self._db.close()
        if self._lock is not None:
            os.close(self._lock)
        self._db = self._lock = None

    def get(self, key: str) -> Done | Failed | None:
        """The stored result of a run, or None if it has none (never run, or crashed)."""
        with self._reading() as db:
            row = db.execute("SELECT * FROM runs WHERE key = ?", (key,)).fetchone()
            if row is None:
                return None
            _check_row(row)
            return self._outcome(row)

    def _outcome(self, row: sqlite3.Row) -> Done | Failed:
        """What a row says; sqlite3.DatabaseError where it is nothing that was stored."""
        try:
            case = dataclasses.replace(Case.from_json(json.loads(row["case"])), objects=str(self.objects))
            key, values, took = row["key"], _values(row["values"]), (row["wall_s"], row["cpu_s"])
            if not all(map(finite, took)):
                raise ValueError("its times are no numbers")
            if row["state"] == "done":
                return Done(key, values, case, _unpack(row["response"]), *took)
            partial = None if row["partial"] is None else _unpack(row["partial"])
            history = tuple(map(dict, json.loads(row["history"])))
            if not isinstance(row["cause"], str) or not isinstance(row["reason"], str):
                raise ValueError("it has no cause or reason")
            return Failed(key, values, case, row["cause"], row["reason"], partial, history, *took)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError, MemoryError, zlib.error) as error:
            raise sqlite3.DatabaseError(f"run {row['key'][:12]}: {type(error).__name__}: {error}") from error

    def put_done(self, run: Done, *, replace: bool = False) -> None:
        """Store an answer; a run that is already stored stays as it is, unless its answer is to be replaced."""
        self._put(run, "done", _pack(run.response), None, None, None, None, verb="REPLACE" if replace else "IGNORE")

    def put_failed(self, run: Failed) -> None:
        """Store that there is no answer; a run that is already stored stays as it is."""
        partial = None if run.partial is None else _pack(run.partial)
        self._put(run, "failed", None, run.cause, _text(run.reason), json.dumps(plain(run.history)), partial)

    def put_crashed(self, run: Crashed) -> None:
        """Note one more crash of a run; it stays without result."""
        row = (run.key, _now(), _text(run.reason), run.case.name, json.dumps(plain(run.values)), run.key)
        with self._writing() as db:
            db.execute("INSERT INTO crashes SELECT ?, ?, ?, count(*) + 1, ?, ? FROM crashes WHERE key = ?", row)

    def artefact(self, recipe: str) -> str | None:
        """SHA-256 of the artefact made from this recipe, or None if there is none (or its file was removed).

        Raises StoreError if the file no longer has this hash.
        """
        with self._reading() as db:
            row = db.execute("SELECT sha FROM artefacts WHERE recipe_hash = ?", (_sha(recipe.encode()),)).fetchone()
            path = None if row is None else object_path(self.objects, row["sha"])
            if path is None or not path.is_file():
                return None
            if _sha(disk.read_bytes(path)) != row["sha"]:
                raise StoreError(f"{path} is damaged (its content has another hash): delete it, it will be made again")
            return str(row["sha"])

    def put_artefact(self, name: str, recipe: str, data: bytes) -> str:
        """Store what was made from a recipe and return its SHA-256; an older artefact of the recipe is replaced."""
        sha = _sha(data)
        path = object_path(self.objects, sha)
        with self._writing() as db:
            _write_durably(path, data)
            db.execute(
                "INSERT OR REPLACE INTO artefacts VALUES (?, ?, ?, ?)", (_sha(recipe.encode()), recipe, name, sha)
            )
        return sha

    def rows(self) -> list[Row]:
        """Every run with its state, in order of storing; a crash that later got a result is not listed."""
        columns = 'key, state, name, "values" AS v, cause, reason, wall_s, cpu_s, created, attempts'
        crashed = """SELECT key, 'crashed', name, "values", NULL, reason, NULL, NULL, "when", max(attempt)
                     FROM crashes WHERE key NOT IN (SELECT key FROM runs) GROUP BY key"""
        with self._reading() as db:
            found = db.execute(f"SELECT {columns} FROM runs UNION ALL {crashed} ORDER BY created, key").fetchall()
            return [_listed(r) for r in found]

    def _put(self, run: Done | Failed, state: str, *columns: object, verb: str = "IGNORE") -> None:
        case = dataclasses.replace(run.case, objects=None).to_json()  # no machine's path in the file
        head = (run.key, state, run.case.name, json.dumps(plain(run.values)), json.dumps(case))
        row = (*head, *columns, float(run.wall_s), float(run.cpu_s), _now())
        sql = f"""INSERT OR {verb} INTO runs SELECT ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, count(*) + 1, ?
                 FROM crashes WHERE key = ?"""
        with self._writing() as db:
            db.execute(sql, (*row, _checksum(row), run.key))

    @contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        if self._db is None:
            raise StoreError(f"{self._file} is not open: use `with RunStore(folder) as store`")
        with _explained(self._file):
            yield self._db

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        if self.read_only:
            raise StoreError(f"{self._file} was opened read-only: nothing can be stored")
        with self._reading() as db:
            try:
                db.execute("BEGIN IMMEDIATE")
                yield db
                db.execute("COMMIT")
            finally:
                if db.in_transaction:
                    db.execute("ROLLBACK")


def set_aside(folder: Path) -> Path:
    """Give a results folder another name, which is returned; StoreError if a process is writing in it."""
    with _explained(folder / "runs.sqlite"):
        lock = _lock(folder / "runs.lock")
        try:
            first = folder.with_name(f"{folder.name}-{datetime.now():%Y%m%d-%H%M%S}")
            aside = next(p for n in range(1, 1000) if not (p := first if n == 1 else Path(f"{first}-{n}")).exists())
            folder.rename(aside)
        finally:
            os.close(lock)
    return aside


def _connect_to_write(file: Path) -> sqlite3.Connection:
    db = sqlite3.connect(file, timeout=30.0, isolation_level=None)
    db.row_factory = sqlite3.Row
    db.execute("BEGIN IMMEDIATE")
    try:
        if db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] == 0:
            for statement in _TABLE_STATEMENTS:
                db.execute(statement)
        db.execute("COMMIT")
        db.execute("PRAGMA synchronous = NORMAL")
        if db.execute("PRAGMA user_version").fetchone()[0] == STORE_SCHEMA:  # leave a foreign file as it is
            db.execute("PRAGMA journal_mode = WAL")
    except BaseException:
        db.close()
        raise
    return db


def _connect_to_read(file: Path) -> sqlite3.Connection:
    if not file.is_file():
        raise StoreError(f"{file} does not exist: nothing has been run in this folder yet, or its runs were moved")
    wal = file.with_name(file.name + "-wal")
    db = sqlite3.connect(f"{file.as_uri()}?mode=ro", uri=True, timeout=30.0)
    try:
        db.execute("PRAGMA user_version")
    except sqlite3.OperationalError:
        db.close()
        if wal.exists() and wal.stat().st_size:
            raise
        # On a read-only disk no log can be set up; without a pending one the file itself is complete.
        db = sqlite3.connect(f"{file.as_uri()}?mode=ro&immutable=1", uri=True)
    db.row_factory = sqlite3.Row
    return db


def _check_schema(db: sqlite3.Connection, file: Path) -> None:
    version = db.execute("PRAGMA user_version").fetchone()[0]
    if not version and not db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
        raise StoreError(f"{file} is empty: the program was stopped before its first run; nothing has been run yet")
    if version != STORE_SCHEMA:
        what = f"has schema {version}" if version else "is not a store of rso"
        raise StoreError(
            f"{file} {what}; this version of rso reads schema {STORE_SCHEMA}: "
            "use the version that wrote it, or move the folder aside and run again"
        )
    parts = db.execute("SELECT type, name FROM sqlite_master WHERE name NOT LIKE 'sqlite@_%' ESCAPE '@'").fetchall()
    hidden = [
        r["name"] for _, table in _SCHEMA_PARTS for r in db.execute(f"PRAGMA table_xinfo({table})") if r["hidden"]
    ]
    if strange := sorted({(r["type"], r["name"]) for r in parts} - _SCHEMA_PARTS) + hidden:
        raise StoreError(
            f"{file} holds {strange[0]!r}, which no store of rso has: is it from somebody else? Move it aside"
        )
    finding = db.execute("PRAGMA quick_check(1)").fetchone()[0]
    if finding != "ok":
        raise sqlite3.DatabaseError(finding)


def _lock(path: Path) -> int:
    """Descriptor that holds the lock until it is closed or the process ends, however it ends."""
    deadline = time.monotonic() + LOCK_TIMEOUT_S
    while True:
        disk.only(path)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(descriptor).st_ino != os.stat(path).st_ino:
                raise BlockingIOError  # the folder was moved aside in this moment: this is the lock of the old one
        except OSError as error:
            holder = os.read(descriptor, 32).decode(errors="replace")
            os.close(descriptor)
            if not isinstance(error, BlockingIOError):
                raise
            # A worker that its killed parent was just starting keeps the lock until it has become its own program.
            if not disk.running(holder) and time.monotonic() < deadline:
                time.sleep(0.02)
                continue
            raise StoreError(
                f"{path.parent} is in use by process {holder or 'of unknown number'}: wait for it to finish or stop "
                "it, or read with `rso status`, which needs no lock"
            ) from None
        os.ftruncate(descriptor, 0)
        os.write(descriptor, str(os.getpid()).encode())
        return descriptor


@contextmanager
def _explained(file: Path) -> Iterator[None]:
    """Turn what sqlite3, zlib, the operating system and bad content raise into StoreError; misuse passes through."""
    try:
        yield
    except (sqlite3.ProgrammingError, sqlite3.IntegrityError):
        raise
    except (sqlite3.OperationalError, OSError) as error:
        raise StoreError(
            f"{file} cannot be used ({error}): check that its folder exists and is writable, and the disk not full, "
            "then run again. Finished runs stay stored"
        ) from error
    except (sqlite3.DatabaseError, zlib.error, ValueError, TypeError, RecursionError, MemoryError) as error:
        raise StoreError(
            f"{file} is damaged ({' '.join(str(error).split())}): restore a copy, or move it aside and run again; "
            "the artefacts beside it in objects/ can stay"
        ) from error


def _write_durably(path: Path, data: bytes) -> None:
    disk.replace(disk.folder(path.parent) / path.name, data, durably=True)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # the new name too must survive a power cut before the database mentions it
    finally:
        os.close(folder)


def _pack(response: Response) -> bytes:
    return zlib.compress(json.dumps(response.to_json(), separators=(",", ":")).encode())


def _unpack(blob: bytes) -> Response:
    unpacking = zlib.decompressobj()
    text = unpacking.decompress(blob, MAX_RESPONSE_BYTES)
    if unpacking.unconsumed_tail:
        raise ValueError(f"its response unpacks to more than {MAX_RESPONSE_BYTES / 1e6:.0f} MB")
    if not unpacking.eof:
        raise ValueError("its response is cut")
    return Response.from_json(json.loads(text))


def _checksum(row: Sequence[object]) -> str:
    """SHA-256 over the columns of a run but for its number of attempts, each with its type and length."""
    total = hashlib.sha256()
    for value in row:
        data = value if isinstance(value, bytes) else repr(value).encode()
        total.update(f"{type(value).__name__} {len(data)} ".encode() + data)
    return total.hexdigest()


def _values(text: str) -> dict[str, float]:
    """The values of a run; ValueError where they are none."""
    values = json.loads(text)
    if not isinstance(values, dict) or not all(map(finite, values.values())):
        raise ValueError("there is no table of values")
    return values


def _listed(r: sqlite3.Row) -> Row:
    """One line of the list; ValueError where its values or times are none."""
    try:
        values = _values(r["v"])
        if not all(v is None or finite(v) for v in r[6:8]):
            raise ValueError("its times are no numbers")
    except (ValueError, TypeError, RecursionError) as error:
        raise ValueError(f"run {str(r['key'])[:12]}: {error}") from error
    cause, reason = (None if r[k] is None else str(r[k]) for k in ("cause", "reason"))
    return Row(
        str(r["key"]), r["state"], str(r["name"]), values, cause, reason, r[6], r[7], str(r["created"]), r["attempts"]
    )


def _check_row(row: sqlite3.Row) -> None:
    """sqlite3.DatabaseError where a row is not the one that was stored; rows of older versions carry no checksum."""
    if "checksum" in row.keys() and row["checksum"] not in (None, _checksum(tuple(row)[:_N_SUMMED_COLUMNS])):
        raise sqlite3.DatabaseError(f"run {row['key'][:12]} is not as it was stored: its checksum is another")


def _with_checksums(db: sqlite3.Connection) -> None:
    """Give a store of an older version the column for checksums."""
    if "checksum" not in {r[1] for r in db.execute("PRAGMA table_info(runs)")}:
        db.execute("ALTER TABLE runs ADD COLUMN checksum TEXT")


def _text(reason: str) -> str:
    """What a backend says, of any characters, as text that can be stored."""
    return str(reason).encode("utf-8", "backslashreplace").decode("utf-8")


def _sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
