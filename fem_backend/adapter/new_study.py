"""A first study of a test with a ball: settings by the options of `rso new`, ranges by the limits of Hertz and JKR."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rso.contract import Line

RESOLVED = 0.035  # of the force at the deepest reading: what the mesh of a new study may miss
AROUND = 3.0  # of the modulus of Hertz's limit, whose half-space the body is not
PULLS = 0.1  # of its range: a force that is negative by more pulls
WIDE = (0.001, 1.0)  # MPa, of a modulus that no force curve tells
PRODUCT = (0.01, 1.8)  # mu D1, at the middle of the range of mu and at its end: ν = 0.4975 and 0.15
Limit = Callable[[np.ndarray, np.ndarray], Mapping[str, float]]  # of depths (n,) mm and Fz (n,) N, by knob


def geometry(given: Mapping[str, tuple[float, ...]]) -> dict[str, Line]:
    """Specimen, indenter, support and law by the options `semi-axes`, `radius` and `bowl` (mm)."""
    bowl = {"kind": "bowl", "clearance": given["bowl"][0], "friction": 0.2} if "bowl" in given else None
    held = 'its lower half; or { kind = "bowl", clearance = 1.0, friction = 0.2 }'
    return {
        "specimen": Line({"shape": "ellipsoid", "semi_axes": list(given["semi-axes"])}),
        "indenter": Line({"shape": "sphere", "radius": given["radius"][0], "shaft": True}),
        "support": Line(bowl, "its friction", True) if bowl else Line({"kind": "fixed"}, held, True),
        "material": Line({"law": "neo_hookean"}, "or linear_elastic, mooney_rivlin, yeoh, ogden", True),
    }


def mesh(depths: Sequence[float], errors_at: Callable[[float], Mapping[str, float]]) -> Line:
    """The cheapest level that resolves the shallowest of tests to `depths` (mm), and what it misses of the force there.

    `errors_at` says of a depth (mm) the share that each level misses, from cheap to dear.
    """
    d = min(depths, default=0.0)
    if d <= 0.0:
        return Line({"level": "coarse"}, "standard, fine and reference cost more")
    errors = errors_at(d)
    level = next((name for name, error in errors.items() if error <= RESOLVED), min(errors, key=errors.__getitem__))
    others = ", ".join(f"{n} {100 * v:.2g} %" for n, v in errors.items() if n != level)
    said = f"about {100 * errors[level]:.2g} % in force at {_two(d)} mm, more where it is shallower; {others}"
    return Line({"level": level}, said)


def parameters(depth: np.ndarray, force: np.ndarray, hertz: Limit, jkr: Limit) -> dict[str, Line]:
    """Ranges about the modulus that Hertz's limit has in a loading Fz (n,) N at depths (n,) mm; wide ones if n = 0.

    The shallow half counts.  Where the force pulls, the JKR limit says modulus and adhesion.  ValueError for a record
    with no modulus.
    """
    mu: float = 0.0
    pull: Mapping[str, float] = {}
    if len(depth):
        shallow = (depth > 0.0) & (depth <= 0.5 * float(depth.max()))
        mu = float(hertz(depth[shallow], force[shallow])["mu"]) if shallow.any() else 0.0
        if _adheres(force):
            pull = jkr(depth, force)
            mu = float(pull.get("mu", mu))
        if mu <= 0.0:
            raise ValueError(
                f"the modulus by Hertz's limit would be {mu:.2g} MPa, which is none: "
                "Fz falls while the ball goes deeper; is it a tensile record, "
                "or a sign or a zero wrong?"
            )
    low, high = (mu / AROUND, mu * AROUND) if mu > 0 else WIDE
    limit = f"Hertz's limit of the shallow half says about {_two(1e3 * mu)} kPa"
    limit = f"adhesion: the JKR limit says about {_two(1e3 * mu)} kPa" if pull else limit
    why = limit if mu > 0 else "no reading tells: narrow it"
    bulk = "bulk modulus K = 2 / D1; Poisson ratio 0.15 where both are high"
    return {
        "mu": _range(1e3 * low, 1e3 * high, "kPa", why),
        "D1": _range(PRODUCT[0] / math.sqrt(low * high), PRODUCT[1] / high, "1/MPa", bulk),
        **_adhesion(pull),
    }


def _adhesion(pull: Mapping[str, float]) -> dict[str, Line]:
    """The range of an adhesion that the record shows."""
    if not pull:
        return {}
    w = float(pull["adhesion"])
    said = f"Fz pulls: adhesion; JKR says about {_two(w)} N/mm, contact at {pull['contact']:.3g} mm in the file"
    return {"adhesion": _range(w / AROUND, w * AROUND, "N/mm", said)}


def _adheres(force: np.ndarray) -> bool:
    """Whether a loading curve (n,) is pulled by more than a tare or its scatter may be."""
    noise = 1.5 * float(np.median(np.abs(np.diff(force, 2)))) / 6**0.5
    return float(force.min()) < -max(PULLS * float(np.ptp(force)), 10.0 * noise) and int(np.argmin(force)) > 0


def _range(low: float, high: float, unit: str, said: str) -> Line:
    return Line({"low": f"{_two(low)} {unit}", "high": f"{_two(high)} {unit}", "scale": "log"}, said, True)


def _two(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"
