"""Point clouds of a surface (digital image correlation): thinned to the most informative points, with own noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rso.core.digits import quantity_text
from rso.data.files.reading import Measurement
from rso.data.measured_curve import MeasuredCurve, Noise

N_CLOUD_POINTS = 30  # of a cloud that are compared unless the study says how many
MAX_CLOUD_IMAGES = 8  # depths that are compared at most
# points over which displacements are averaged before they say where much moves: their noise must not
N_AVERAGED_NEIGHBOURS = 9


class UnstatedNoise(ValueError):
    """A channel of a point cloud has no noise, which cannot be read off one image."""


@dataclass(frozen=True, eq=False)
class SurfaceCloud:
    """Displacements (n,) mm of material points of a surface in images taken at several depths, in rows.

    `depth` (n,) mm, reference places `position` (n, 2) mm and `component` (n,), "ux", "uy" or "uz", of each reading;
    `covariance` (n, n) of their errors.  `points` of the `seen` points of every image are kept, and `images` of
    `taken`; `lost` points are missing in some image.
    """

    depth: np.ndarray
    position: np.ndarray
    component: np.ndarray
    value: np.ndarray
    covariance: np.ndarray
    points: int
    seen: int
    lost: int
    images: int
    taken: int

    @property
    def sigma(self) -> np.ndarray:
        """Standard uncertainty (n,) of each reading."""
        return np.sqrt(np.diag(self.covariance))


def surface_cloud(measurement: Measurement, noise: Noise, components: Sequence[str], points: int) -> SurfaceCloud:
    """The readings of a cloud that are compared, with the covariance of their errors.

        C = σ_c² e^{−|Δx|/ℓ} δ_cc' δ_kk'  +  s² δ_cc' δ_kk'  +  (d² δ_kk' + o²) u' u'ᵀ

    c is the component, k the image: noise of standard deviation σ_c, correlated over ℓ on the surface; a shift s of the
    camera in each image; the depth of an image off by d, that of all images by o, with the slope u' of each point over
    depth.  What nobody states of o is usual (:mod:`~rso.data.usual_errors`).  ValueError for several repeats, a missing
    component, noise that is not stated, and images without a point in common.
    """
    where = measurement.where
    if len(measurement.repeats) > 1:
        tests = len(measurement.repeats)
        raise ValueError(f"{where}: a point cloud is one test; give each of its {tests} repeats its own experiment")
    r = measurement.repeats[0]
    if silent := [c for c in components if not noise.of(c) > 0.0]:
        raise UnstatedNoise(
            f'{where}: state the noise of {", ".join(silent)} of a point cloud: noise = {{ uz = "5 um" }}'
        )
    there = r.depth > 0.0
    images, image = np.unique(np.round(r.depth[there], 9), return_inverse=True)
    places, place = np.unique(
        np.round(np.stack([r.channels["x"], r.channels["y"]], axis=1)[there], 9) + 0.0, axis=0, return_inverse=True
    )
    place = place.ravel()
    table = np.full((len(components), len(images), len(places)), np.nan)
    count = np.zeros(table.shape[1:], int)
    np.add.at(count, (image, place), 1)
    if (count > 1).any():
        k, p = np.argwhere(count > 1)[0]
        raise ValueError(
            f"{where}: the point ({places[p, 0]:g}, {places[p, 1]:g}) mm stands twice at "
            f"{quantity_text(images[k], 'mm', 6)}"
        )
    for c, name in enumerate(components):
        table[c, image, place] = r.channels[name][there]
    whole = (count > 0).all(axis=0)
    if not whole.any():
        raise ValueError(
            f"{where}: no point is in all {len(images)} images (depths). x_mm and y_mm are its place on the undeformed "
            "surface, the same at every depth; depth_mm is that of the image"
        )
    taken = len(images)
    kept = np.unique(np.linspace(0, taken - 1, min(taken, MAX_CLOUD_IMAGES)).round().astype(int))
    images, table, seen = images[kept], table[:, kept][:, :, whole], places[whole]
    chosen = most_informative(seen, table[:, -1], [noise.of(c) for c in components], noise.surface_correlation, points)
    table, at = table[:, :, chosen], seen[chosen]
    shape = table.shape
    c, k, p = (i.ravel() for i in np.indices(shape))
    depth, value = images[k], table.ravel()
    same = (c[:, None] == c) & (k[:, None] == k)
    σ = np.array([noise.of(n) for n in components])[c]
    C = np.where(same, np.outer(σ, σ) * surface_correlation(at[p], noise.surface_correlation), 0.0)
    C += noise.camera**2 * same
    slope = _slopes(images, table).ravel()
    contact = noise.of_test(float(images[-1])).contact
    C += (noise.depth**2 * (k[:, None] == k) + contact**2) * np.outer(slope, slope)
    return SurfaceCloud(
        depth, at[p], np.array(components)[c], value, C,
        len(at), len(seen), int((~whole).sum()), len(images), taken,
    )  # fmt: skip


def cloud_curve(cloud: SurfaceCloud, component: str) -> MeasuredCurve:
    """One component of a cloud as a curve with places; ValueError for one that it has not."""
    rows = np.flatnonzero(cloud.component == component)
    if not len(rows):
        raise ValueError(f"no {component} in this point cloud; there are {', '.join(np.unique(cloud.component))}")
    C = cloud.covariance[np.ix_(rows, rows)]
    return MeasuredCurve(
        component, "mm", cloud.depth[rows], cloud.value[rows], np.sqrt(np.diag(C)), 1, C, cloud.position[rows]
    )


def said_of_cloud(cloud: SurfaceCloud) -> list[str]:
    """What of a cloud is compared, in sentences."""
    rule = ", the most informative ones (docs/data.md)" if cloud.points < cloud.seen else ""
    said = [f"Compared are {cloud.points} of {cloud.seen} points of the surface{rule}."]
    if cloud.images < cloud.taken:
        said.append(f"Compared are {cloud.images} of {cloud.taken} depths, evenly spread to the deepest.")
    if cloud.lost:
        said.append(f"Left out are {cloud.lost} points that are missing at some depth.")
    return said


def surface_correlation(places: np.ndarray, length: float) -> np.ndarray:
    """Correlation (n, n) e^{−|Δx|/ℓ} of noise at places (n, 2); of length 0 that of each point with itself."""
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    return np.exp(-apart / length) if length > 0.0 else (apart == 0.0).astype(float)


def most_informative(
    places: np.ndarray, moved: np.ndarray, noise: Sequence[float], length: float, most: int
) -> np.ndarray:
    """Points (k,) of places (n, 2) that inform most on a field of displacements, taken one after the other.

        next = arg max_i  S_ii / N_ii,    S = K + N,    K_ij = w_i w_j e^{−|Δx|²/2L²},    N_ij = e^{−|Δx|/ℓ}

    both given the points that are taken: each step adds most to log |S|/|N|, the information on a Gaussian field K in
    noise N.  w is the displacement `moved` (c, n) in the deepest image over its `noise` (c,), averaged over neighbours;
    L is the size of the dent, the root mean square distance of what moves from its middle, in steps of w².
    Greedy choice is within 1 − 1/e of the best: Krause, Singh & Guestrin, J. Mach. Learn. Res. 9 (2008) 235.
    """
    n = len(places)
    if n <= most:
        return np.arange(n)
    from scipy.spatial import cKDTree

    near = cKDTree(places).query(places, k=min(N_AVERAGED_NEIGHBOURS, n))[1]
    w2 = np.sum((moved[:, near].mean(axis=2) / np.array(noise)[:, None]) ** 2, axis=0)
    w2 = np.maximum(w2, 1e-12 * w2.max() or 1.0)
    middle = np.average(places, axis=0, weights=w2)
    away2 = np.sum((places - middle) ** 2, axis=1)
    size = float(np.sqrt(np.average(away2, weights=w2))) or 1.0
    # Three numbers of the field alone: a choice by each point's own reading would prefer large errors.
    shape = 1.0 / (1.0 + away2 / size**2)
    w2 = shape * float(w2.sum() / shape.sum())
    w = np.sqrt(w2)
    signal, white = w2 + 1.0, np.ones(n)
    parts: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    chosen: list[int] = []
    for _ in range(most):
        gain = np.where(white > 1e-9, signal / np.maximum(white, 1e-9), -np.inf)
        gain[chosen] = -np.inf
        i = int(np.argmax(gain))
        if not np.isfinite(gain[i]):
            break
        chosen.append(i)
        apart = np.linalg.norm(places - places[i], axis=1)
        N = np.exp(-apart / length) if length > 0.0 else (apart == 0.0).astype(float)
        K = w * w[i] * np.exp(-0.5 * (apart / size) ** 2)
        for left, column, rows in ((signal, K + N, parts[0]), (white, N, parts[1])):  # pivoted Cholesky
            column = column - sum((v * v[i] for v in rows), np.zeros(n))
            column = column / np.sqrt(max(column[i], 1e-300))
            rows.append(column)
            left -= column**2
    return np.sort(np.array(chosen))


def _slopes(images: np.ndarray, table: np.ndarray) -> np.ndarray:
    """∂u/∂depth of displacements (c, k, p) in images at depths (k,) mm: of a d + b d² through contact, if there are two
    images; one shows only u/d."""
    terms = np.stack([images, images**2], axis=1)[:, : min(2, len(images))]
    slopes = np.stack([np.ones_like(images), 2.0 * images], axis=1)[:, : terms.shape[1]]
    fit = slopes @ np.linalg.pinv(terms)
    return np.einsum("kj,cjp->ckp", fit, table)
