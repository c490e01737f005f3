"""What another code, mesh or formula, or nature, may make of an effect: freedom for every hypothesis that has it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rso.diagnosis.effects import Effect
from rso.diagnosis.hypotheses import blocks
from rso.diagnosis.library import Library
from rso.diagnosis.mixture import Tiles
from rso.diagnosis.prediction import predict
from rso.diagnosis.runs import nearest

SHARE = 0.1  # by which an effect may be stronger or weaker in a part of the data
LATERAL = 0.25  # the same in Fx and Fy: two meshes differ so in friction beside the top
VARIANT = 0.15  # of another support: how far a body slides or rolls before it is held
LOOP = 0.25  # of the widest loop that friction can make: whether it creeps before it slides no coefficient says


def loosened(library: Library, effects: Sequence[Effect], own: Tiles, base: Tiles, modulus: float) -> Tiles:
    """Tiles whose effect may be somewhat stronger or weaker in each part of the data, and its loop another.

    y_g → y_g + ζ_g (y_g − base_g),  ζ_g ~ N(0, share²) for every place, branch, and Fz or lateral forces apart: the
    interpolation between the library's nodes, another code or mesh, another formula of the same effect.  What rubs may
    in addition come back otherwise than it went:  y → y + ζ ℓ,  ζ ~ N(0, LOOP²),  ℓ its :func:`loops`.
    """
    variant = any(e.settings for e in effects)
    share = VARIANT if variant else SHARE
    d = len(library.base.axes)
    near = np.array([int(np.argmin(np.sum((base.at[:, :d] - x) ** 2, axis=1))) for x in own.at[:, :d]])
    none = (base.lift(base.A) @ own.basis, base.lift(base.c) @ own.basis)  # own vectors span these
    change = own.A - none[0][near] + (own.c - none[1][near]) / modulus
    groups: dict[tuple[int, bool, int], np.ndarray] = {}
    for (place, c, branch), rows in blocks(library.plan).items():
        of_block = np.any(own.basis[rows] != 0.0, axis=0)
        key = (place, c == "Fz", branch)
        groups[key] = groups.get(key, np.zeros(len(of_block), bool)) | of_block
    more = change[:, None] * np.array(list(groups.values()))
    sd = [share if normal else LATERAL for _, normal, _ in groups]
    if any(e.name in library.rubbing for e in effects):
        loop = loops(library, effects, own, modulus) @ own.basis
        if np.any(loop):
            more, sd = np.concatenate([more, loop[:, None]], axis=1), [*sd, LOOP]
    return replace(
        own,
        D=np.concatenate([own.D, more], axis=1),
        sd=np.concatenate([own.sd, sd]),
        axes=(*own.axes, *[-1] * len(sd)),
        log=(*own.log, *[False] * len(sd)),
    )


def loops(library: Library, effects: Sequence[Effect], own: Tiles, modulus: float) -> np.ndarray:
    """ℓ (T, n): force on the way back less that on the way there, of the tile with the widest loop at the same κ."""
    places = []
    for here in library.places:
        there = [nearest(here.passes, None, p.earlier) for p in here.passes]
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
