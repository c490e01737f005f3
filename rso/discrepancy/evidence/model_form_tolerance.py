"""What another code, mesh or formula, or nature, may make of an effect: freedom for every hypothesis that has it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rso.discrepancy.evidence.gaussian_mixture import Tiles
from rso.discrepancy.evidence.hypotheses import blocks
from rso.discrepancy.evidence.settings import DIAGNOSIS_SETTINGS, EffectTolerance
from rso.discrepancy.library.effects import Effect
from rso.discrepancy.library.prediction import predict
from rso.discrepancy.library.simulations import Pass, nearest_pass
from rso.discrepancy.library.tables import Library


def with_tolerance(
    library: Library,
    effects: Sequence[Effect],
    own: Tiles,
    base: Tiles,
    modulus: float,
    tolerance: EffectTolerance = DIAGNOSIS_SETTINGS.tolerance,
) -> Tiles:
    """Tiles whose effect may be somewhat stronger or weaker in each part of the data, and its loop another.

    y_g → y_g + ζ_g (y_g − base_g),  ζ_g ~ N(0, share²) for every place, branch, and Fz or lateral forces apart: the
    interpolation between the library's nodes, another code or mesh, another formula of the same effect.  Another
    support is weaker in proportion, F_g → F_g (F_g / base_g)^ζ: where it holds nothing it does so too; and of several
    places each may have another size,  y_p → y_p + ζ_p ∂y_p/∂ ln s,  ζ_p ~ N(0, way²).  What rubs may in addition
    come back otherwise than it went:  y → y + ζ ℓ,  ζ ~ N(0, loop²),  ℓ its :func:`loops`.  What flows may be
    quicker or slower at each place:  y_p → y_p + ζ_p ∂y_p/∂ ln k,  ζ_p ~ N(0, rate²).
    """
    assert own.basis is not None  # tiles are compressed
    d = len(library.base.axes)
    near = np.array([int(np.argmin(np.sum((base.at[:, :d] - x) ** 2, axis=1))) for x in own.at[:, :d]])
    none = (base.lift(base.A) @ own.basis, base.lift(base.c) @ own.basis)  # own vectors span these
    change = own.A - none[0][near] + (own.c - none[1][near]) / modulus
    parts = blocks(library.plan)
    if any(e.settings for e in effects):
        rows = np.concatenate([np.zeros(0, int), *[rows for (_, c, _), rows in parts.items() if c == "Fz"]])
        change = own.lift(change)
        change[:, rows] = _in_proportion(own.lift(own.A + own.c / modulus)[:, rows], change[:, rows])
        change = change @ own.basis
    groups: dict[tuple[int, bool, int], np.ndarray] = {}
    for (place, c, branch), rows in parts.items():
        of_block = np.any(own.basis[rows] != 0.0, axis=0)
        key = (place, c == "Fz", branch)
        groups[key] = groups.get(key, np.zeros(len(of_block), bool)) | of_block
    more = change[:, None] * np.array(list(groups.values()))
    sd = [tolerance.share if normal else tolerance.lateral for _, normal, _ in groups]
    places = sorted({place for place, _, _ in groups if place >= 0})
    for direction in _sizes_of_supports(effects, own, d) if len(places) > 1 else []:
        masks = [np.any([m for (at, _, _), m in groups.items() if at == place], axis=0) for place in places]
        more = np.concatenate([more, direction[:, None] * np.array(masks)], axis=1)
        sd += [tolerance.way] * len(places)
    for direction in _rates(effects, own, d):
        masks = [np.any([m for (at, _, _), m in groups.items() if at == place], axis=0) for place in places]
        more = np.concatenate([more, direction[:, None] * np.array(masks)], axis=1)
        sd += [tolerance.rate] * len(places)
    if any(e.name in library.rubbing for e in effects):
        loop = loops(library, effects, own, modulus) @ own.basis
        if np.any(loop):
            more, sd = np.concatenate([more, loop[:, None]], axis=1), [*sd, tolerance.loop]
    return replace(
        own,
        D=np.concatenate([own.D, more], axis=1),
        sd=np.concatenate([own.sd, sd]),
        axes=(*own.axes, *[-1] * len(sd)),
        log=(*own.log, *[False] * len(sd)),
    )


def _in_proportion(F: np.ndarray, change: np.ndarray) -> np.ndarray:
    """∂/∂ζ of F (F/F₀)^ζ at ζ = 0, F ln (F/F₀), with F₀ = F − change; nothing where only one of them pushes."""
    before = F - change
    same = F * before > 0.0
    ratio = np.divide(F, before, out=np.ones_like(F), where=same)
    return F * np.log(ratio)


def _sizes_of_supports(effects: Sequence[Effect], own: Tiles, d: int) -> list[np.ndarray]:
    """∂y/∂ ln s (T, r) for the size s of every other support that has one; it comes first among an effect's knobs."""
    found = []
    first = d + np.cumsum([0, *(len(e.knobs) for e in effects)])
    for e, at in zip(effects, first[:-1], strict=True):
        if e.settings and at in own.axes:
            direction = own.D[:, own.axes.index(int(at))]
            found.append(direction if e.size.logarithmic else own.at[:, [at]] * direction)
    return found


def _rates(effects: Sequence[Effect], own: Tiles, d: int) -> list[np.ndarray]:
    """∂y/∂ ln k (T, r) of every rate of what flows."""
    found = []
    first = d + np.cumsum([0, *(len(e.knobs) for e in effects)])
    for e, begins in zip(effects, first[:-1], strict=True):
        for j, knob in enumerate(e.knobs):
            if e.flows and j and knob.power_of_time < 0 and (at := int(begins) + j) in own.axes:
                found.append(own.D[:, own.axes.index(at)])
    return found


def loops(library: Library, effects: Sequence[Effect], own: Tiles, modulus: float) -> np.ndarray:
    """ℓ (T, n): force in unloading less that on the way there, of the tile with the widest loop at the same κ."""
    places = []
    for here in library.places:
        there = [nearest_pass(here.passes, Pass(None, p.earlier)) for p in here.passes]
        straight = {
            n: replace(t, change=t.change[:, there]) if n in library.rubbing else t for n, t in here.effects.items()
        }
        places.append(replace(here, effects=straight))
    back = replace(library, places=tuple(places))
    loop = own.lift(own.A) - predict(back, effects, own.at, modulus)[0]
    width = np.sum(loop**2, axis=1)
    same = np.unique(own.at[:, : len(library.base.axes)], axis=0, return_inverse=True)[1].reshape(-1)
    widest = {k: np.nonzero(same == k)[0][np.argmax(width[same == k])] for k in np.unique(same)}
    return loop[[widest[k] for k in same]]
