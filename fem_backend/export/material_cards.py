"""The law of a study in the words of other programs, each with what its manual says that the constants mean.

Every law here is W(Ī₁, Ī₂) + (J − 1)²/D₁ or a sum of powers of isochoric stretches with the same volume term.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from fem_backend.laws.law import Law
from fem_backend.laws.material import Material

MATERIAL_NAME = "SPECIMEN"  # where a caller gives none


class NotWritten(ValueError):
    """What another program cannot say, or what is not written for it, in words."""


@dataclass(frozen=True)
class Constants:
    """A law as other programs know it: (i, j) → C_ij MPa, or terms (μᵢ MPa, αᵢ), D₁ 1/MPa, Prony terms (g, τ s).

    `small` says that it is linear elasticity of small strains, with E (MPa) and ν.
    """

    mu: float
    D1: float
    polynomial: Mapping[tuple[int, int], float] | None
    powers: tuple[tuple[float, float], ...] | None
    prony: tuple[tuple[float, float], ...]
    small: bool

    @property
    def K(self) -> float:
        """Bulk modulus 2/D₁ (MPa)."""
        return 2.0 / self.D1

    @property
    def E(self) -> float:
        """Young's modulus of small strains, 9Kμ/(3K + μ) (MPa)."""
        return 9.0 * self.K * self.mu / (3.0 * self.K + self.mu)

    @property
    def nu(self) -> float:
        """Poisson's ratio of small strains, (3K − 2μ)/(6K + 2μ)."""
        return (3.0 * self.K - 2.0 * self.mu) / (6.0 * self.K + 2.0 * self.mu)

    def c(self, i: int, j: int = 0) -> float:
        """C_ij (MPa), 0 where there is none."""
        return (self.polynomial or {}).get((i, j), 0.0)


def card_constants(stuff: Material, factor: float = 1.0) -> Constants:
    """The law of a material, all of whose moduli are `factor` times as large; NotWritten for effects beyond the law."""
    if stuff.fibre is not None:
        raise NotWritten("fibres are not written for other programs: their laws of fibres differ")
    if stuff.mullins is not None:
        raise NotWritten("softening (Mullins) is not written for other programs")
    law: Law = stuff.law
    polynomial, powers = law.polynomial, law.powers_of_stretch
    if polynomial is None and powers is None and not law.small_strain:
        raise NotWritten(f"the law {law.name!r} has no counterpart in the programs that cards are written for")
    prony = () if stuff.prony is None else tuple(zip(stuff.prony.g, stuff.prony.tau, strict=True))
    return Constants(
        factor * law.shear_modulus,
        2.0 / (factor * law.bulk_modulus),
        None if polynomial is None else {k: factor * v for k, v in polynomial.items()},
        None if powers is None else tuple((factor * m, a) for m, a in powers),
        prony,
        law.small_strain,
    )


def abaqus(c: Constants, name: str = MATERIAL_NAME) -> list[str]:
    """Lines of Abaqus and CalculiX: C_ij and D₁ as here, Ogden's W = Σ (2μᵢ/αᵢ²)(…) too.

    Source: Abaqus Analysis User's Guide, Hyperelastic behavior of rubberlike materials; CalculiX 2.20 manual,
    *HYPERELASTIC: U = Σ C_ij (Ī₁ − 3)^i (Ī₂ − 3)^j + Σ (J − 1)^2i/Dᵢ.  Both take shares of relaxation from the
    instantaneous moduli where these are given (Abaqus only: MODULI=INSTANTANEOUS).
    """
    lines = [f"*MATERIAL, NAME={name}"]
    if c.small:
        return [*lines, "*ELASTIC", f"{c.E:.12g}, {c.nu:.12g}"]
    moduli = ", MODULI=INSTANTANEOUS" if c.prony else ""
    if c.powers is not None:
        n = len(c.powers)
        numbers = [v for term in c.powers for v in term] + [c.D1] + [0.0] * (n - 1)
        first = ", ".join(f"{v:.12g}" for v in numbers[:8])
        rest = ", ".join(f"{v:.12g}" for v in numbers[8:])
        lines += [f"*HYPERELASTIC, OGDEN, N={n}{moduli}", first, *([rest] if rest else [])]
    elif c.c(2) or c.c(3):
        lines += [f"*HYPERELASTIC, YEOH{moduli}"]
        lines += [", ".join(f"{v:.12g}" for v in (c.c(1), c.c(2), c.c(3), c.D1, 0.0, 0.0))]
    elif c.c(0, 1):
        lines += [f"*HYPERELASTIC, MOONEY-RIVLIN{moduli}", f"{c.c(1):.12g}, {c.c(0, 1):.12g}, {c.D1:.12g}"]
    else:
        lines += [f"*HYPERELASTIC, NEO HOOKE{moduli}", f"{c.c(1):.12g}, {c.D1:.12g}"]
    if c.prony:
        lines += ["*VISCOELASTIC, TIME=PRONY", *(f"{g:.12g}, 0, {tau:.12g}" for g, tau in c.prony)]
    return lines


def calculix(c: Constants, name: str = MATERIAL_NAME) -> list[str]:
    """The same for CalculiX, which has no relaxation of hyperelastic materials."""
    if c.prony:
        raise NotWritten("CalculiX has no relaxation of hyperelastic materials")
    return abaqus(c, name)


def ansys(c: Constants, name: str = MATERIAL_NAME) -> list[str]:
    """Commands of ANSYS Mechanical APDL; Ogden's W = Σ (mᵢ/αᵢ)(…), so mᵢ = 2μᵢ/αᵢ.

    Source: ANSYS Mechanical APDL Material Reference, Hyperelasticity: neo-Hooke W = (μ/2)(Ī₁ − 3) + (1/d)(J − 1)²,
    Mooney–Rivlin and Yeoh with C_ij and (1/d)(J − 1)²; Prony shares of the instantaneous shear modulus.
    """
    lines = [f"! {name}", "*SET,MAT_ID,1"]
    if c.small:
        return [*lines, f"MP,EX,MAT_ID,{c.E:.12g}", f"MP,PRXY,MAT_ID,{c.nu:.12g}"]
    if c.powers is not None:
        n = len(c.powers)
        data = [v for m, a in c.powers for v in (2.0 * m / a, a)] + [c.D1] + [0.0] * (n - 1)
        lines += [f"TB,HYPER,MAT_ID,1,{n},OGDEN", *_tbdata(data)]
    elif c.c(2) or c.c(3):
        lines += ["TB,HYPER,MAT_ID,1,3,YEOH", *_tbdata([c.c(1), c.c(2), c.c(3), c.D1, 0.0, 0.0])]
    elif c.c(0, 1):
        lines += ["TB,HYPER,MAT_ID,1,2,MOONEY", *_tbdata([c.c(1), c.c(0, 1), c.D1])]
    else:
        lines += ["TB,HYPER,MAT_ID,1,,NEO", *_tbdata([2.0 * c.c(1), c.D1])]
    if c.prony:
        lines += [f"TB,PRONY,MAT_ID,1,{len(c.prony)},SHEAR", *_tbdata([v for term in c.prony for v in term])]
    return lines


def _tbdata(values: Sequence[float]) -> list[str]:
    """TBDATA takes six numbers a line."""
    return [f"TBDATA,{k + 1}," + ",".join(f"{v:.12g}" for v in values[k : k + 6]) for k in range(0, len(values), 6)]


def febio(c: Constants) -> tuple[str, dict[str, str]]:
    """Type and parameters of a material of FEBio 4, whose `pressure_model` 2 ("Abaqus") is U = (K/2)(J − 1)².

    Source: FEBio 4 source, FEUncoupledMaterial.h: U(J) by pressure_model; FEMooneyRivlin: W = c1(Ī₁ − 3) + c2(Ī₂ − 3);
    FEYeoh: W = Σ cᵢ(Ī₁ − 3)^i; FEOgdenMaterial: W = Σ (cᵢ/mᵢ²)(…), so cᵢ = 2μᵢ.  (Its "neo-Hookean" with E and v is
    another law: μ/2 (I₁ − 3) − μ ln J + λ/2 ln²J.)
    """
    if c.prony:
        raise NotWritten("relaxation is not written for FEBio")
    if c.small:
        raise NotWritten('FEBio has no small strains: its "isotropic elastic" is St Venant and Kirchhoff\'s law')
    volume = {"k": f"{c.K:.12g}", "pressure_model": "2"}
    if c.powers is not None:
        terms: dict[str, str] = {}
        for k, (m, a) in enumerate(c.powers, 1):
            terms |= {f"c{k}": f"{2.0 * m:.12g}", f"m{k}": f"{a:.12g}"}
        return "Ogden", {**terms, **volume}
    if c.c(2) or c.c(3):
        return "Yeoh", {"c1": f"{c.c(1):.12g}", "c2": f"{c.c(2):.12g}", "c3": f"{c.c(3):.12g}", **volume}
    return "Mooney-Rivlin", {"c1": f"{c.c(1):.12g}", "c2": f"{c.c(0, 1):.12g}", **volume}


def febio_card(c: Constants, name: str = MATERIAL_NAME) -> list[str]:
    """The same as an element of the section Material."""
    kind, parameters = febio(c)
    inner = [f"  <{key}>{value}</{key}>" for key, value in parameters.items()]
    return [f'<material id="1" name="{name}" type="{kind}">', *inner, "</material>"]


def sofa(c: Constants, name: str = MATERIAL_NAME) -> list[str]:
    """A force field of SOFA: another volume term, so that it agrees at small changes of volume only.

    Source: SOFA source, NeoHookean.h: W = μ/2 (I₁ − 3) − μ ln J + λ/2 ln²J with λ = K − 2μ/3.
    """
    if c.prony or c.small or c.powers is not None or set(c.polynomial or {}) - {(1, 0)}:
        raise NotWritten("for SOFA neo-Hooke is written alone")
    lam = c.K - 2.0 * c.mu / 3.0
    return [
        "# SOFA's neo-Hooke is mu/2 (I1 - 3) - mu ln J + lambda/2 ln^2 J, not the law that was fitted:",
        "# the same E and nu at small strains, and the same answer as far as the volume hardly changes",
        f'node.addObject("TetrahedronHyperelasticityFEMForceField", name="{name}", materialName="NeoHookean",',
        f'               ParameterSet="{c.mu:.12g} {lam:.12g}")',
    ]


@dataclass(frozen=True)
class Card:
    """A card of one program: its file, what a comment begins with and ends with, and who writes it."""

    file: str
    comment: tuple[str, str]
    write: Callable[[Constants], list[str]]


CARDS: Mapping[str, Card] = {
    "Abaqus": Card("material_abaqus.inp", ("** ", ""), abaqus),
    "CalculiX": Card("material_calculix.inp", ("** ", ""), calculix),
    "ANSYS": Card("material_ansys.mac", ("! ", ""), ansys),
    "FEBio": Card("material_febio.xml", ("<!-- ", " -->"), febio_card),
    "SOFA": Card("material_sofa.py", ("# ", ""), sofa),
}


def cards(c: Constants, remarks: Sequence[str]) -> dict[str, str]:
    """File → the card of each program, with `remarks` as comments; where a program has no such law, that as one."""
    found = {}
    for program, card in CARDS.items():
        left, right = card.comment
        head = [f"Material for {program}; units N, mm, MPa, s", *remarks]
        try:
            lines = card.write(c)
        except NotWritten as error:
            lines, head = [], [*head, f"not written: {error}"]
        comments = [f"{left}{line.replace('--', '- -')}{right}" for line in head]
        found[card.file] = "\n".join([*comments, *lines]) + "\n"
    return found
