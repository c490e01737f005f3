"""What every law is: W(Ī₁, Ī₂) + U(J) with Ī₁ = J^(-2/3) tr C and Ī₂ = J^(-4/3) (tr²C − tr C²)/2, U = (J − 1)²/D₁."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol

import numpy as np
from pydantic import BeforeValidator, field_validator

from fem_backend import members
from fem_backend.members import OpenSet
from rso.contract import knob

LAWS: OpenSet[Law] = OpenSet("material", "law", "neo_hookean")


class Derivatives(NamedTuple):
    """W₁ = ∂W/∂Ī₁, W₂, W₁₁, W₁₂, W₂₂, U′ = dU/dJ and U″ at points (…); MPa."""

    w1: np.ndarray
    w2: np.ndarray
    w11: np.ndarray
    w12: np.ndarray
    w22: np.ndarray
    u1: np.ndarray
    u2: np.ndarray


def pairs(what: str, value: Any) -> tuple[tuple[float, float], ...]:
    """A list of pairs of finite numbers."""
    if not isinstance(value, list | tuple):
        raise members.refused(f": a list of {what} is expected")
    return tuple((a, b) for a, b in map(members.numbers(2), value))


def prony_terms(value: Any) -> tuple[tuple[float, float], ...]:
    """Further Prony terms (g, τ in s): g ≥ 0, τ > 0, Σg < 1."""
    terms = pairs("[g, tau in s]", value)
    if any(g < 0 or tau <= 0 for g, tau in terms) or sum(g for g, _ in terms) >= 1:
        raise members.refused(": g >= 0, tau > 0 and a sum of g below 1 are needed", value=list(map(list, terms)))
    return terms


class LawTable(members.MemberTable):
    """What every law's table holds besides its name."""

    ogden: tuple[tuple[float, float], ...] = ()
    """Further terms (alpha, share of mu), of law = "ogden" alone."""
    prony: Annotated[tuple[tuple[float, float], ...], BeforeValidator(prony_terms)] = ()
    """Terms (g, tau in s) of relaxation besides those of the knobs."""

    @field_validator("ogden", mode="before")
    @classmethod
    def _terms(cls, value: Any) -> tuple[tuple[float, float], ...]:
        """Further terms belong to another law."""
        if pairs("[alpha, share of mu]", value):
            name = cls.model_fields["law"].default
            raise members.refused(f' is given but law = "{name}"; set law = "ogden"')
        return ()

    def build(self) -> LawTable:
        """The law is made with the knobs of a run: see `Law.of`."""
        return self


def canonical_law(
    law: str, terms: tuple[tuple[float, float], ...], prony: tuple[tuple[float, float], ...]
) -> dict[str, Any]:
    """The table of a law as it enters the key of a run, with all defaults written out."""
    return {"law": law, "ogden": [list(t) for t in terms], "prony": [list(t) for t in prony]}


@dataclass(frozen=True)
class Elastic:
    """Knobs of every law."""

    mu: float = knob("initial shear modulus", "MPa", 1e-6, 1e3)
    D1: float = knob("compressibility, bulk modulus K = 2/D1", "1/MPa", 1e-6, 1e6)


class Law(Protocol):
    """An isotropic hyperelastic law of the two isochoric invariants; one file a law, registered in `LAWS`.

    `powers` are those of a stress in its own knobs that have one.  `unconditional` laws are admissible at every
    stretch; `principal` ones give `isochoric` by principal stretches instead of `derivatives`.  `own_at_neutral`: its
    own knobs keep their influence at their neutral value where it is the law of the settings.  `rung` and `level`
    place it in the model hierarchy: see :mod:`fem_backend.adapter.model_hierarchy`.
    """

    name: ClassVar[str]
    Table: ClassVar[type[LawTable]]
    Knobs: ClassVar[type | None]
    powers: ClassVar[Mapping[str, int]]
    small_strain: ClassVar[bool]
    unconditional: ClassVar[bool]
    principal: ClassVar[bool]
    own_at_neutral: ClassVar[bool]
    rung: ClassVar[int]
    level: ClassVar[Mapping[str, Any]]

    @classmethod
    def of(cls, knobs: Any, terms: tuple[tuple[float, float], ...]) -> Law:
        """The law with these knobs and further terms of the settings."""

    @classmethod
    def used(cls, knobs: Any, terms: tuple[tuple[float, float], ...]) -> bool:
        """Whether its own knobs are off their neutral values, so that it is meant whatever the settings say."""

    def hessian(self, e: np.ndarray) -> np.ndarray:
        """∂²W/∂eₐ∂e_b (n, 3, 3), MPa, at incompressible logarithmic stretches e (n, 3)."""

    @property
    def shear_modulus(self) -> float:
        """Initial shear modulus μ (MPa); every penalty is a multiple of it."""

    @property
    def bulk_modulus(self) -> float:
        """Initial bulk modulus K (MPa)."""

    @property
    def polynomial(self) -> Mapping[tuple[int, int], float] | None:
        """C_ij (MPa) of W = Σ C_ij (Ī₁ − 3)^i (Ī₂ − 3)^j; None of a law that is no such polynomial."""

    @property
    def powers_of_stretch(self) -> tuple[tuple[float, float], ...] | None:
        """(μᵢ MPa, αᵢ) of W = Σ (2μᵢ/αᵢ²)(λ̄₁^αᵢ + λ̄₂^αᵢ + λ̄₃^αᵢ − 3); None of a law that is no such sum."""

    def energy(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> np.ndarray:
        """Strain energy per reference volume (MPa)."""

    def derivatives(self, i1: np.ndarray, i2: np.ndarray, J: np.ndarray) -> Derivatives:
        """First and second derivatives of the energy."""


@dataclass(frozen=True)
class Isotropic:
    """The two constants that all laws share: initial shear modulus μ (MPa) and D₁ (1/MPa), K = 2/D₁."""

    mu: float
    D1: float

    Table: ClassVar[type] = LawTable
    Knobs: ClassVar[type | None] = None
    powers: ClassVar[Mapping[str, int]] = {}
    small_strain: ClassVar[bool] = False
    unconditional: ClassVar[bool] = False
    principal: ClassVar[bool] = False
    own_at_neutral: ClassVar[bool] = False

    @classmethod
    def of(cls, knobs: Any, terms: tuple[tuple[float, float], ...] = ()) -> Isotropic:
        """The law of μ, D₁ and its own knobs."""
        own = {} if cls.Knobs is None else {f.name: getattr(knobs, f.name) for f in dataclasses.fields(cls.Knobs)}
        return cls(knobs.mu, knobs.D1, **own)

    @classmethod
    def used(cls, knobs: Any, terms: tuple[tuple[float, float], ...] = ()) -> bool:
        """Whether one of its own knobs is off its neutral value."""
        own = () if cls.Knobs is None else dataclasses.fields(cls.Knobs)
        return any(getattr(knobs, f.name) != f.default for f in own)

    def hessian(self, e: np.ndarray) -> np.ndarray:
        """By the derivatives with Ī₁ = Σ exp 2e, Ī₂ = Σ exp(−2e)."""
        up, down = np.exp(2.0 * e), np.exp(-2.0 * e)
        d = self.derivatives(up.sum(-1), down.sum(-1), np.ones(e.shape[0]))
        w1, w2, w11, w12, w22 = (v[:, None, None] for v in d[:5])
        g1, g2 = 2.0 * up, -2.0 * down
        cross = g1[:, :, None] * g2[:, None, :]
        curve = w11 * g1[:, :, None] * g1[:, None, :] + w12 * (cross + cross.swapaxes(1, 2))
        curve += w22 * g2[:, :, None] * g2[:, None, :]
        return curve + 4.0 * (w1 * up[:, :, None] + w2 * down[:, :, None]) * np.eye(3)

    @property
    def shear_modulus(self) -> float:
        return self.mu

    @property
    def bulk_modulus(self) -> float:
        return 2.0 / self.D1

    @property
    def polynomial(self) -> Mapping[tuple[int, int], float] | None:
        """C_ij (MPa) of W = Σ C_ij (Ī₁ − 3)^i (Ī₂ − 3)^j; None of a law that is no such polynomial."""
        return None

    @property
    def powers_of_stretch(self) -> tuple[tuple[float, float], ...] | None:
        """(μᵢ MPa, αᵢ) of W = Σ (2μᵢ/αᵢ²)(λ̄₁^αᵢ + λ̄₂^αᵢ + λ̄₃^αᵢ − 3); None of a law that is no such sum."""
        return None

    def volume_energy(self, J: np.ndarray) -> np.ndarray:
        """U = (J − 1)²/D₁ (MPa)."""
        return (J - 1.0) ** 2 / self.D1

    def pressure(self, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """U′ = 2(J − 1)/D₁ and U″ = 2/D₁ (MPa)."""
        return 2.0 * (J - 1.0) / self.D1, np.full_like(J, 2.0 / self.D1)
