"""What `rso run` has found, as tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd


@dataclass(frozen=True)
class RunResult:
    """Results of a study: the folder that holds them, and `data`, which is results.json (see docs/results.md).

    Lengths are in mm, forces in N, moduli in MPa, times in s, unless a column `unit` says otherwise.
    """

    folder: Path
    data: Mapping[str, Any] = field(repr=False)

    @property
    def exit_code(self) -> int:
        """As `rso run` ends: 0 where all is done and verified; `exit_reason` says why not."""
        return int(self.data["exit_code"])

    @property
    def exit_reason(self) -> str | None:
        """Why the exit code is not 0, or None."""
        reason = self.data["exit_reason"]
        return None if reason is None else str(reason)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the report warns of."""
        return tuple(self.data["warnings"])

    @property
    def parameters(self) -> pd.DataFrame:
        """A row per parameter: most likely value, unit, ends `low` and `high` of the interval, verdict, a sentence.

        Numbers are NaN where the data say nothing; a fixed parameter has its value and the verdict ``fixed``.
        """
        found = self.data.get("identification") or {}
        known = {p["parameter"]: p for p in found.get("parameters", ())}
        rows = {}
        for p in self.data["parameters"]:
            one = known.get(p["name"])
            fixed = p["fixed"] is not None
            low, high = (p["fixed"],) * 2 if fixed else one["interval"] if one else (None, None)
            rows[p["name"]] = {
                "value": p["fixed"] if fixed else one["value"] if one else None,
                "unit": p["unit"],
                "low": low,
                "high": high,
                "verdict": "fixed" if fixed else one["verdict"] if one else "not",
                "words": "" if fixed else one["story"] if one else "no interval can be stated",
            }
        table = pd.DataFrame.from_dict(rows, orient="index")
        return table.astype({"value": float, "low": float, "high": float}).rename_axis("parameter")

    @property
    def derived(self) -> pd.DataFrame:
        """A row per quantity that follows from the parameters (E, ν, …): value, unit, ends of its interval, words."""
        found = (self.data.get("identification") or {}).get("derived") or ()
        rows = {
            q["name"]: {
                "value": q["value"],
                "unit": q["unit"],
                "low": q["interval"][0],
                "high": q["interval"][1],
                "known": q["known"],
                "words": q["description"],
            }
            for q in found
        }
        columns = ["value", "unit", "low", "high", "known", "words"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("quantity")

    @property
    def level(self) -> float | None:
        """Confidence level of the intervals, or None where there are none."""
        found = self.data.get("identification")
        return None if found is None else float(found["level"])

    @property
    def candidates(self) -> pd.DataFrame:
        """A row per candidate: its search and name, values, how its run ended, whether it is verified and meets all.

        `nrmse <experiment>` is the misfit of each curve over its range, NaN without an answer.
        """
        rows = []
        for search in self.data.get("searches") or ():
            for c in search["candidates"]:
                head = {"search": search["name"], "candidate": c["name"], **c["values"]}
                head |= {"state": c["state"], "verified": c["verified"], "meets": c["meets"]}
                rows.append(head | {f"nrmse {name}": m["nrmse"] for name, m in (c["metrics"] or {}).items()})
        return pd.DataFrame(rows)

    @property
    def runs(self) -> pd.DataFrame:
        """A row per simulation: purpose, state, values, outputs (empty unless done), cause, reason, costs (s), key."""
        rows = []
        for run in self.data.get("runs") or ():
            head = {"purpose": run["purpose"], "state": run["state"], **run["values"], **run["outputs"]}
            rows.append(head | {k: run[k] for k in ("cause", "reason", "wall_s", "cpu_s", "key")})
        return pd.DataFrame(rows)

    @property
    def curves(self) -> pd.DataFrame:
        """A row per reading and per point of each candidate's curve, `what` says which (``measured`` or its name).

        Columns: experiment, channel, what, depth, value, error (one standard deviation of a reading, the estimated
        numerical error of a simulation), unit.
        """
        rows: list[pd.DataFrame] = []
        units: dict[tuple[str, str], str] = {}
        for e in self.data["experiments"]:
            own = {"channel": e["channel"], "unit": e["unit"], "measured": e["measured"]}
            for one in (own, *e["others"]):
                units[e["name"], one["channel"]] = one["unit"]
                m = one["measured"]
                rows.append(_curve(e["name"], one["channel"], "measured", one["unit"], m, m["sigma"]))
        for search in self.data.get("searches") or ():
            for c in search["candidates"]:
                for curve in c["curves"].values():
                    unit = units[curve["experiment"], curve["channel"]]
                    name = c["name"] if search["name"] == "main" else f"{search['name']} {c['name']}"
                    rows.append(_curve(curve["experiment"], curve["channel"], name, unit, curve, curve["error"]))
        return pd.concat(rows, ignore_index=True)

    def report(self, folder: str | Path | None = None, *, html: bool = True, pdf: bool = True) -> list[Path]:
        """Write report.html and report.pdf to a folder (that of the results without one); their paths."""
        from rso.report import render

        place = self.folder if folder is None else Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        return render(dict(self.data), place, html=html, pdf=pdf)


def _curve(
    experiment: str, channel: str, what: str, unit: str, curve: Mapping[str, Any], error: Any
) -> pd.DataFrame:  # fmt: skip
    n = len(curve["depth"])
    columns = {"depth": curve["depth"], "value": curve["value"], "error": error}
    fixed = {"experiment": [experiment] * n, "channel": [channel] * n, "what": [what] * n}
    return pd.DataFrame({**fixed, **columns, "unit": [unit] * n})
