"""What is going on: a live line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from typing import Any

from rso.core.printable import as_one_entry, raw_stream
from rso.core.symbols import in_units
from rso.evaluation import Event, Finished, Planned, Preparing, Retried

PLAIN_LINE_PERIOD_S = 20.0  # between plain lines


class Progress:
    """Context manager; `watch` takes the events of the dispatcher, `say` the stages of a study; `quiet` shows none."""

    def __init__(self, quiet: bool = False) -> None:
        self._quiet = quiet
        self._terminal = sys.stdout.isatty() and not quiet
        self._bar: Any = None
        self._task: Any = None
        self._last = time.monotonic()
        self._counts = {"done": 0, "failed": 0, "crashed": 0}
        self._first: tuple[float, int] | None = None  # when a run ended first, and how many were known then

    def __enter__(self) -> Progress:
        if self._terminal:
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            console = Console(
                file=raw_stream(sys.stdout)
            )  # its own codes go through; texts are made printable by `say`
            self._bar = Progress(
                *columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False
            )
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def say(self, text: str) -> None:
        """One line."""
        if self._quiet:
            return
        if self._bar is not None:
            self._bar.console.print(as_one_entry(in_units(text)), markup=False, highlight=False)
        else:
            print(as_one_entry(in_units(text)), flush=True)

    def watch(self, event: Event) -> None:
        """Show an event of :func:`rso.evaluation.run_all`."""
        if self._quiet:
            return
        if isinstance(event, Preparing):
            self.say(f"  preparing {event.n_artefacts} artefact(s) (meshes)")
        elif isinstance(event, Planned):
            self._planned(event)
        elif isinstance(event, Retried):
            self.say(f"  {event.name}: crashed, tried again ({event.reason.splitlines()[0]})")
        elif isinstance(event, Finished):
            self._finished(event)

    def _planned(self, event: Planned) -> None:
        self._counts = {"done": 0, "failed": 0, "crashed": 0}
        self._first = None
        if event.n_runs > event.n_cached:
            known = f", {event.n_cached} of them in the store" if event.n_cached else ""
            self.say(f"  {event.n_runs} simulation{'s' if event.n_runs > 1 else ''}{known}")
        if self._bar is not None:
            if self._task is not None:
                self._bar.remove_task(self._task)
            self._task = self._bar.add_task("  simulating", total=event.n_runs, completed=event.n_cached)

    def _finished(self, event: Finished) -> None:
        self._counts[event.state] += 1
        if self._bar is not None:
            bad = [f"{n} {state}" for state, n in self._counts.items() if n and state != "done"]
            self._bar.update(self._task, completed=event.n_done, description="  simulating " + " ".join(bad))
            return
        now = time.monotonic()
        if self._first is None:
            self._first = (now, event.n_done)
        if event.n_done == event.n_runs or now - self._last > PLAIN_LINE_PERIOD_S or event.state != "done":
            self._last = now
            counts = ", ".join(f"{n} {state}" for state, n in self._counts.items() if n)
            print(f"  {event.n_done}/{event.n_runs} ({counts}){self._rest(event, now)}", flush=True)

    def _rest(self, event: Finished, now: float) -> str:
        """How long the others may take, by the pace since the first end: runs may begin before they are planned."""
        begun, known = self._first or (now, event.n_done)
        if not known < event.n_done < event.n_runs:
            return ""
        return f", about {(now - begun) / (event.n_done - known) * (event.n_runs - event.n_done):.0f} s left"
