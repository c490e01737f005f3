"""The key of a run: everything that its answer depends on."""

from __future__ import annotations

from collections.abc import Mapping

from rso.contract.backend import Backend
from rso.contract.capabilities import Fingerprint, capability
from rso.contract.cases import Case
from rso.contract.plain_data import by_contents, digest, plain


def run_key(backend: Backend, values: Mapping[str, float], case: Case) -> str:
    """Content address of a run: everything that influences the answer and nothing else (no names, no paths).

    `values` and `case` are expected in the backend's canonical form.
    """
    marked = capability(backend, Fingerprint)
    fingerprint = "" if marked is None else marked.fingerprint
    return digest(
        {
            **({"fingerprint": fingerprint} if fingerprint else {}),
            "backend": backend.name,
            "numerics": backend.numerics,
            "values": {k: float(v) for k, v in values.items()},
            "programme": case.programme.plain(),
            "settings": by_contents(plain(case.settings)),
            "artefacts": dict(case.artefacts),
        }
    )
