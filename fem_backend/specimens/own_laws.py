"""Layers with a law of their own: the table that chooses it, the knobs of its constants, the law that these make."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

from fem_backend import members
from fem_backend.laws import LAWS, Law
from rso.contract import knob

LAYER_PREFIXES = ("layer", "layer2", "layer3")  # what names of knobs begin with, from the uppermost layer down
LAYER_WORDS = ("the uppermost layer", "the second layer", "the third layer")


@dataclass(frozen=True)
class OwnLaw:
    """The law of a layer by its name, and its further terms (α, share of μ)."""

    law: str
    terms: tuple[tuple[float, float], ...] = ()

    def plain(self) -> dict[str, Any]:
        """Its table as it enters the key of a run."""
        return {LAWS.tag: self.law, "ogden": [list(t) for t in self.terms]}


@dataclass(frozen=True)
class Stiffness:
    """μ and D₁ of a layer with a law of its own; the names of its knobs have the layer before them."""

    mu: float = knob(
        "initial shear modulus; 0: the layer's ratio times mu, for a layer with a law of its own",
        "MPa",
        0.0,
        1e3,
        neutral=0.0,
    )
    D1: float = knob(
        "compressibility, bulk modulus K = 2/D1; 0: K/mu is that of the rest, for a layer with a law of its own",
        "1/MPa",
        0.0,
        1e6,
        neutral=0.0,
    )


def read_own_law(value: Any) -> OwnLaw | None:
    """The law that a table names; relaxation is refused, as it is that of the whole body, and so are small strains."""
    if value is None:
        return None
    if not isinstance(value, Mapping):
        raise members.refused(f": a table such as {{ {LAWS.tag} = {LAWS.default!r} }} is expected")
    try:
        table = LAWS.read(value)
    except ValueError as error:
        raise members.refused(f": {error}") from None
    if table.prony:
        raise members.refused(": a layer relaxes as the whole body does; prony belongs to the table material")
    if LAWS.members[table.law].small_strain:
        raise members.refused(": a layer takes a law of finite strain", LAWS.tag, table.law)
    return OwnLaw(table.law, table.ogden)


def _schema() -> dict[str, Any]:
    """What `--schema` says of the table."""
    names = [n for n, law in LAWS.members.items() if not law.small_strain]
    pairs = {"type": "array", "items": {"type": "array", "items": {"type": "number"}}}
    return {"type": "object", "properties": {LAWS.tag: {"enum": names}, "ogden": pairs}, "additionalProperties": False}


OwnMaterial = Annotated[OwnLaw | None, BeforeValidator(read_own_law), WithJsonSchema(_schema())]


def own_knob_name(prefix: str, constant: str) -> str:
    """The knob of a constant: layer_mu, layer2_C20."""
    return f"{prefix}_{constant}"


def knobs() -> list[type]:
    """Dataclasses of the knobs of layers with a law of their own, one for each layer that may have some."""
    return list(_knobs(tuple(LAWS.knobs())))


@functools.cache
def _knobs(laws: tuple[type, ...]) -> tuple[type, ...]:
    return tuple(_of_layer(prefix, words, laws) for prefix, words in zip(LAYER_PREFIXES, LAYER_WORDS, strict=True))


def _of_layer(prefix: str, words: str, laws: tuple[type, ...]) -> type:
    """The constants of every law again, as those of one layer."""
    fields = []
    for f in (f for part in (Stiffness, *laws) for f in dataclasses.fields(part)):
        p = f.metadata["parameter"]
        own = dataclasses.replace(
            p,
            description=f"{p.description}, of {words}",
            group=p.group and own_knob_name(prefix, p.group),
            cause=p.cause and f"{p.cause} of {words}",
            label=p.label and f"{p.label}, of {words}",
        )
        fields.append(
            (own_knob_name(prefix, f.name), float, dataclasses.field(default=own.default, metadata={"parameter": own}))
        )
    return dataclasses.make_dataclass(f"Knobs_{prefix}", fields, frozen=True)


def own_knob_names(prefix: str, law: str | None = None) -> frozenset[str]:
    """Names of the knobs of a layer: those of its law, or of all laws."""
    own = LAWS.own(law) if law is not None else frozenset().union(*map(LAWS.own, LAWS.members))
    return frozenset(own_knob_name(prefix, name) for name in ("mu", "D1", *own))


def everything() -> frozenset[str]:
    """Names of the knobs of all layers."""
    return _everything(tuple(LAWS.members))


@functools.lru_cache(maxsize=16)
def _everything(laws: tuple[str, ...]) -> frozenset[str]:
    """The same as long as the registered `laws` are: every run of a study asks for it."""
    return frozenset().union(*map(own_knob_names, LAYER_PREFIXES))


def absent(laws: Sequence[OwnLaw | None]) -> frozenset[str]:
    """Names of the knobs that say nothing of a body whose layers have these laws."""
    present = [own_knob_names(p, own.law) for p, own in zip(LAYER_PREFIXES, laws, strict=False) if own]
    return everything().difference(*present)


def always(laws: Sequence[OwnLaw | None]) -> frozenset[str]:
    """Names of those that keep their influence at their neutral value."""
    own = [(p, v) for p, v in zip(LAYER_PREFIXES, laws, strict=False) if v and LAWS.members[v.law].own_at_neutral]
    return frozenset(own_knob_name(p, name) for p, v in own for name in LAWS.own(v.law))


def own_law_powers() -> dict[str, int]:
    """Power of a stress in the knobs that have one."""
    each = {"mu": 1, "D1": -1, **{k: p for law in LAWS.members.values() for k, p in law.powers.items()}}
    return {own_knob_name(prefix, name): p for prefix in LAYER_PREFIXES for name, p in each.items()}


def law_of_layer(own: OwnLaw, prefix: str, knobs: Any, ratio: float) -> Law:
    """The law of a layer: μ from its knob or `ratio` times that of the rest, K/μ likewise, other constants its own."""
    mu = (getattr(knobs, own_knob_name(prefix, "mu")) or ratio * knobs.mu) * (
        knobs.layer_ratio if prefix == LAYER_PREFIXES[0] else 1.0
    )
    D1 = getattr(knobs, own_knob_name(prefix, "D1")) or knobs.D1 * knobs.mu / mu
    rest = {name: getattr(knobs, own_knob_name(prefix, name)) for name in LAWS.own(own.law)}
    return LAWS.members[own.law].of(SimpleNamespace(mu=mu, D1=D1, **rest), own.terms)
