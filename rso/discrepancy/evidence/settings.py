"""Everything that a diagnosis assumes before it has seen data, in one place: what decides a verdict.

`python benchmarks/diagnosis STUDY --sections settings` halves and doubles each number and prints what becomes of the
verdicts.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class HypothesisPriors:
    """Probabilities of hypotheses before any data, and the sizes of what no hypothesis of the catalogue names.

    `single` to `partly` sum to 1 given that there is a gap.  A free gap is (relative size, length over which it changes
    as a share of the deepest travel): screws, tears and slips are rough, what models lack is smooth; a wrong size or
    length costs 5 to 10 of log evidence.
    """

    no_gap: float = 0.5  # probability that the base model holds
    single: float = 0.70  # one effect
    pair: float = 0.10  # two effects
    unexplained: float = 0.08  # a free gap alone
    partly: float = 0.12  # one effect and a free gap
    gaps: tuple[tuple[float, float], ...] = ((0.01, 0.2), (0.03, 0.2), (0.15, 0.2), (0.01, 0.06), (0.03, 0.06))
    alone: tuple[tuple[float, float], ...] = ((0.03, 0.2), (0.03, 0.06))  # free gaps of one experiment alone
    scatter: tuple[float, ...] = (0.15, 0.6)  # of what differs from curve to curve, shares of its largest size
    present: float = 0.5  # that an effect of the measurement chain is there beside what is said
    seldom: float = 0.04  # the same of an effect of the body, the indenter or the support

    def of(self, kind: str) -> float:
        """Probability of a kind of hypothesis with a gap, before any data."""
        given: float = getattr(self, kind)
        return (1.0 - self.no_gap) * given


@dataclass(frozen=True)
class ModelError:
    """What the model may be wrong by beside its stated numerical error, relative to the force.

    Lengths are shares of the deepest travel.  The sizes come from two finite element codes on one problem.
    """

    code: float = 0.005  # another code or mesher, in each test
    length: float = 0.35  # over which that changes
    deep: float = 0.015  # more of it at the deepest travel, where meshes distort
    steep: float = 8.0  # power of the travel with which that grows
    grain: float = 0.001  # elements that come into contact one by one
    grain_length: float = 0.06
    common: float = 0.01  # one code beside another in all tests alike, as a re-fit of the modulus takes it
    common_length: float = 1.0
    lateral: float = 0.25  # share of the error of Fz that shows in Fx and Fy


@dataclass(frozen=True)
class UsualNoise:
    """Noise of a laboratory where neither the study nor its repeats state any; lengths of a plan of the usual depth."""

    gain: float = 0.01  # of a test, relative
    contact: float = 0.01  # mm, contact point of a test
    reading: float = 0.01  # of the largest force, where too few readings tell
    mark: float = 0.05  # mm, of a mark's displacement


@dataclass(frozen=True)
class EffectTolerance:
    """By how much (sd) another code, or nature, may make an effect stronger or weaker in a part of the data."""

    share: float = 0.1  # in Fz, relative
    lateral: float = 0.25  # in Fx and Fy: two meshes differ so in friction beside the top
    way: float = 0.2  # of the size of another support: how far a body slides or rolls in it before it is held
    loop: float = 0.25  # of the widest loop that friction can make
    rate: float = 0.15  # in ln of what sets the time of a flow, at each place


@dataclass(frozen=True)
class VerdictRules:
    """Where probabilities become words."""

    apart: float = 4.0  # standard deviations by which a flow must differ from every network of relaxation times

    false_alarm: float = 0.05  # p-value up to which there is a gap
    sure: float = 0.95  # probability of one cause above which it is named alone
    cover: float = 0.95  # of the probability that a named set holds
    worth_naming: float = 0.05  # probability below which a second effect of a pair is not named
    most: int = 5  # effects in a named set
    misfit: float = 1.3  # χ² per reading that a whole cause may leave; a right one leaves about 1
    rare: float = 0.01  # of few readings: chance of what a right cause leaves beyond which that is too much
    beyond: float = 1.15  # times the largest plausible size: a cause that needs more is a part
    lone: float = 0.9  # probability beyond which one experiment is the odd one


@dataclass(frozen=True)
class DiagnosisSettings:
    """All of these."""

    priors: HypothesisPriors = field(default_factory=HypothesisPriors)
    model_error: ModelError = field(default_factory=ModelError)
    noise: UsualNoise = field(default_factory=UsualNoise)
    tolerance: EffectTolerance = field(default_factory=EffectTolerance)
    rules: VerdictRules = field(default_factory=VerdictRules)


DIAGNOSIS_SETTINGS = DiagnosisSettings()
