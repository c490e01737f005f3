"""The line below a title: what simulated, with which versions, when, from which seed and which data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rso.report.layout.digits import clean

_HASH_CHARACTERS, _MAX_BYLINE_FILES = 8, 2  # characters of a hash, and files, that a line has room for


def byline(found: Mapping[str, Any]) -> str:
    """From the plain data of any command; what is not known is left out."""
    study, backend, made = (found.get(k) or {} for k in ("study", "backend", "provenance"))
    name = backend.get("name") or made.get("backend")
    said = [f"Simulations by {clean(name)}"] if name else []
    said += [f"rso {clean(made['rso'])}"] if made.get("rso") else []
    said += [clean(made["finished"])[:10]] if made.get("finished") else []
    said += [f"seed {clean(study['seed'])}"] if study.get("seed") is not None else []
    hashes = [clean(h)[:_HASH_CHARACTERS] for h in (made.get("data_sha256") or {}).values()]
    more = f" and {len(hashes) - _MAX_BYLINE_FILES} more" if len(hashes) > _MAX_BYLINE_FILES else ""
    said += [f"data {', '.join(hashes[:_MAX_BYLINE_FILES])}{more}"] if hashes else []
    return " · ".join(said)
