"""What contact does at its points: compiled loops over facets and quadrature points.

Arrays and letters are those of :mod:`fem_backend.contact.tractions`; `opened` is the gap at the start of the step,
`bound` a limit of the friction that does not follow the pressure now.
"""

from __future__ import annotations

import numpy as np

from fem_backend.compiled import compiled

TANGENTIAL_PENALTY_RATIO = 0.3  # ε_T/ε: sticking points give way by t/ε_T, some 0.01 mm
# of the ball's way until it touches a point, by which that lags behind: least error of one to three steps
LAG_SHARE = 0.3
MAX_ADHESION_RANGES = 40.0  # ranges of the adhesion: exp(−40) is beyond round-off


@compiled()
def facet_points(facets, N, x):  # type: ignore[no-untyped-def]
    """Points (f, q, 3) of quadratic facets: triangles or, of a meridian, edges."""
    points = np.zeros((len(facets), len(N), 3))
    for f in range(len(facets)):
        for q in range(len(N)):
            for a in range(N.shape[1]):
                for i in range(3):
                    points[f, q, i] += N[q, a] * x[facets[f, a], i]
    return points


@compiled()
def _attract(g, work, length):  # type: ignore[no-untyped-def]
    """ψ, σ = ψ′ and σ′ of the adhesion at a gap g."""
    if g >= 0.0:
        e = np.exp(-g / length)
        return -work * e, work / length * e, -work / length**2 * e
    e = np.exp(g / length)
    return work * (2.0 * g / length - e), work / length * (2.0 - e), -work / length**2 * e


@compiled()
def _share(gap, before, met):  # type: ignore[no-untyped-def]
    """Share of the step in touch, its derivative by the gap, and the share of the rigid body's way that counts."""
    if before <= 0.0:
        return 1.0, 0.0, 1.0
    if met >= 0.0:
        return met, 0.0, 1.0 - LAG_SHARE * (1.0 - met)
    if gap >= 0.0:
        return 0.0, 0.0, 1.0
    return -gap / (before - gap), -before / (before - gap) ** 2, 1.0


@compiled()
def _trial(n, point, start, traction, motion, counts, stiff, v, t):  # type: ignore[no-untyped-def]
    """Fill v = t₀ − ε_T (Δx − what counts of Δc) and its tangential part t; returns |n|², n·v/|n|² and |t|."""
    square, along = 0.0, 0.0
    for i in range(3):
        v[i] = traction[i] - stiff * (point[i] - start[i] - counts * motion[i])
        square += n[i] * n[i]
        along += n[i] * v[i]
    along /= square
    size = 0.0
    for i in range(3):
        t[i] = v[i] - along * n[i]
        size += t[i] * t[i]
    return square, along, np.sqrt(size)


@compiled()
def _rubs(friction, p, bilateral, bound, f, q):  # type: ignore[no-untyped-def]
    """Whether there may be friction at a point: where it presses, or is held on to and friction has a limit anyhow."""
    return friction > 0.0 and (p > 0.0 or (bilateral and bound[f, q] >= 0.0))


@compiled()
def evaluate_points(  # type: ignore[no-untyped-def]
    facets,
    N,
    weights,
    count,
    points,
    gap,
    normal,
    epsilon,
    multiplier,
    friction,
    start,
    before,
    opened,
    bound,
    met,
    motion,
    work,
    length,
    bilateral,
):
    m, nq = weights.shape
    residual, force = np.zeros((count, 3)), np.zeros(3)
    pressure, attraction = np.zeros((m, nq)), np.zeros((m, nq))
    traction, slipping = np.zeros((m, nq, 3)), np.zeros((m, nq), np.bool_)
    v, t, load = np.empty(3), np.empty(3), np.empty(3)
    energy = 0.0
    for f in range(m):
        for q in range(nq):
            w, g, n = weights[f, q], gap[f, q], normal[f, q]
            p = multiplier[f, q] - epsilon[f, q] * g
            if p < 0.0 and not bilateral:
                p = 0.0
            energy += 0.5 * w * (p * p - multiplier[f, q] ** 2) / epsilon[f, q]
            near = work > 0.0 and g < MAX_ADHESION_RANGES * length
            if not (p > 0.0 or near or bilateral):
                continue
            pressure[f, q] = p
            for i in range(3):
                load[i] = p * n[i]
            if _rubs(friction, p, bilateral, bound, f, q):
                share, _, counts = _share(g, opened[f, q], met[f, q])
                stiff = share * TANGENTIAL_PENALTY_RATIO * epsilon[f, q]
                _, _, size = _trial(n, points[f, q], start[f, q], before[f, q], motion, counts, stiff, v, t)
                limit = bound[f, q] if bound[f, q] >= 0.0 else friction * p
                slipping[f, q] = size > limit
                cut = limit / size if slipping[f, q] else 1.0
                if bound[f, q] >= 0.0 and stiff > 0.0:
                    energy += w * (limit * (size - 0.5 * limit) if slipping[f, q] else 0.5 * size * size) / stiff
                for i in range(3):
                    traction[f, q, i] = cut * t[i]
                    load[i] += traction[f, q, i]
            if near:
                potential, pull, _ = _attract(g, work, length)
                attraction[f, q] = pull
                energy += w * potential
                for i in range(3):
                    load[i] -= pull * n[i]
            for i in range(3):
                force[i] -= w * load[i]
                for a in range(N.shape[1]):
                    residual[facets[f, a], i] -= N[q, a] * w * load[i]
    return residual, force, pressure, traction, slipping, attraction, energy


@compiled()
def tangent_at_points(  # type: ignore[no-untyped-def]
    facets,
    N,
    weights,
    place,
    points,
    normal,
    hessian,
    gap,
    pressure,
    epsilon,
    friction,
    start,
    before,
    opened,
    bound,
    met,
    motion,
    work,
    length,
    bilateral,
    direction,
    geometric,
    data,
    moving,
):
    m, nq = weights.shape
    size = 3 * N.shape[1]
    k, along_way, block = np.empty((3, 3)), np.empty((3, 3)), np.empty((size, size))
    v, t, went = np.empty(3), np.empty(3), np.empty(3)
    for f in range(m):
        block[:, :] = 0.0
        for q in range(nq):
            w, g, p, n, h, e = weights[f, q], gap[f, q], pressure[f, q], normal[f, q], hessian[f, q], epsilon[f, q]
            near = work > 0.0 and g < MAX_ADHESION_RANGES * length
            if not (p > 0.0 or near or bilateral):
                continue
            stiff, turn = (e if p > 0.0 or bilateral else 0.0), -p
            if near:
                _, pull, fall = _attract(g, work, length)
                turn += pull
                if geometric:
                    stiff += fall
            _normal(k, n, h, stiff, turn, geometric)
            counts = 1.0
            if _rubs(friction, p, bilateral, bound, f, q):
                share, growth, counts = _share(g, opened[f, q], met[f, q])
                stick = share * TANGENTIAL_PENALTY_RATIO * e
                square, along, long = _trial(n, points[f, q], start[f, q], before[f, q], motion, counts, stick, v, t)
                for i in range(3):
                    way = points[f, q, i] - start[f, q, i] - motion[i]
                    went[i] = growth * TANGENTIAL_PENALTY_RATIO * e * way if geometric else 0.0
                if counts < 1.0:  # of the rigid body's way less counts than of the point's
                    along_way[:, :] = k
                    part, own = counts * stick, bound[f, q]
                    _friction(along_way, n, h, square, along, long, t, v, p, e, part, went, friction, own, geometric)
                _friction(k, n, h, square, along, long, t, v, p, e, stick, went, friction, bound[f, q], geometric)
            if counts == 1.0:
                along_way[:, :] = k
            _add(block, k, N[q], w)
            for i in range(3):
                rate = along_way[i, 0] * direction[0] + along_way[i, 1] * direction[1] + along_way[i, 2] * direction[2]
                for a in range(N.shape[1]):
                    moving[facets[f, a], i] -= w * N[q, a] * rate
        for r in range(size):
            for c in range(size):
                if place[f, r, c] >= 0:
                    data[place[f, r, c]] += block[r, c]


@compiled()
def attract(facets, N, weights, count, gap, normal, work, length):  # type: ignore[no-untyped-def]
    """Residual, force, attraction and energy of ∫ ψ(g) dA₀ alone."""
    m, nq = weights.shape
    residual, force, attraction = np.zeros((count, 3)), np.zeros(3), np.zeros((m, nq))
    energy = 0.0
    for f in range(m):
        for q in range(nq):
            if gap[f, q] >= MAX_ADHESION_RANGES * length:
                continue
            potential, pull, _ = _attract(gap[f, q], work, length)
            attraction[f, q] = pull
            energy += weights[f, q] * potential
            for i in range(3):
                load = weights[f, q] * pull * normal[f, q, i]
                force[i] += load
                for a in range(N.shape[1]):
                    residual[facets[f, a], i] += N[q, a] * load
    return residual, force, attraction, energy


@compiled()
def tangent_of_attraction(  # type: ignore[no-untyped-def]
    facets, N, weights, place, gap, normal, hessian, work, length, direction, geometric, data, moving
):
    """Add ∂R/∂x of `attract`, σ′ n⊗n + σ ∇∇g, to `data` and ∂R/∂s to `moving`; nothing unless `geometric`."""
    m, nq = weights.shape
    size = 3 * N.shape[1]
    k, block = np.empty((3, 3)), np.empty((size, size))
    if not geometric:
        return
    for f in range(m):
        block[:, :] = 0.0
        touched = False
        for q in range(nq):
            if gap[f, q] >= MAX_ADHESION_RANGES * length:
                continue
            touched = True
            _, pull, fall = _attract(gap[f, q], work, length)
            _normal(k, normal[f, q], hessian[f, q], fall, pull, True)
            _add(block, k, N[q], weights[f, q])
            for i in range(3):
                rate = k[i, 0] * direction[0] + k[i, 1] * direction[1] + k[i, 2] * direction[2]
                for a in range(N.shape[1]):
                    moving[facets[f, a], i] -= weights[f, q] * N[q, a] * rate
        if not touched:
            continue
        for r in range(size):
            for c in range(size):
                if place[f, r, c] >= 0:
                    data[place[f, r, c]] += block[r, c]


@compiled()
def evaluate_rings(facets, N, dN, around, weights, x, points, normal, epsilon, multiplier, p, known):  # type: ignore[no-untyped-def]
    """Residual, force, pressure per reference area and energy of Σ ψ a, ψ = (p² − λ²)/(2ε), with p `known` in ψ."""
    m, nq = p.shape
    residual, force, pressure = np.zeros(x.shape), np.zeros(3), np.zeros((m, nq))
    energy = 0.0
    for f in range(m):
        for q in range(nq):
            if p[f, q] == 0.0 and multiplier[f, q] == 0.0:
                continue
            tr, tz, length = _along(facets[f], dN[q], x)
            r = points[f, q, 0]
            area = around[q] * r * length
            pull = p[f, q] * area
            psi = 0.5 * (known[f, q] ** 2 - multiplier[f, q] ** 2) / epsilon[f, q]
            energy += psi * area
            pressure[f, q] = pull / weights[f, q]
            for i in range(3):
                force[i] -= pull * normal[f, q, i]
            for a in range(3):
                node, n, d = facets[f, a], N[q, a], dN[q, a] * around[q] * r / length
                residual[node, 0] += psi * (around[q] * length * n + d * tr) - pull * n * normal[f, q, 0]
                residual[node, 2] += psi * d * tz - pull * n * normal[f, q, 2]
    return residual, force, pressure, energy


@compiled()
def _along(facet, dN, x):  # type: ignore[no-untyped-def]
    """∂r/∂t, ∂z/∂t and their length."""
    tr, tz = 0.0, 0.0
    for a in range(3):
        tr += dN[a] * x[facet[a], 0]
        tz += dN[a] * x[facet[a], 2]
    return tr, tz, np.sqrt(tr * tr + tz * tz)


@compiled()
def tangent_of_rings(  # type: ignore[no-untyped-def]
    facets, N, dN, around, place, x, points, normal, hessian, epsilon, multiplier, pressure, direction, geometric, data,
    moving,
):  # fmt: skip
    """Add ∂R/∂x of `evaluate_rings` with pressures p to `data` and ∂R/∂s of a rigid body that moves to `moving`."""
    m, nq = pressure.shape
    block, da, n = np.empty((6, 6)), np.empty(6), np.empty(6)
    for f in range(m):
        touched = False
        block[:, :] = 0.0
        for q in range(nq):
            p, e, lam = pressure[f, q], epsilon[f, q], multiplier[f, q]
            if p == 0.0 and lam == 0.0:
                continue
            touched = True
            tr, tz, length = _along(facets[f], dN[q], x)
            r, two = points[f, q, 0], around[q]
            area, psi = two * r * length, 0.5 * (p * p - lam * lam) / e
            n0, n2 = normal[f, q, 0], normal[f, q, 2]
            for a in range(3):
                da[2 * a] = two * (length * N[q, a] + r * dN[q, a] * tr / length)
                da[2 * a + 1] = two * r * dN[q, a] * tz / length
                n[2 * a], n[2 * a + 1] = N[q, a] * n0, N[q, a] * n2
            stiff = e * area if p != 0.0 else 0.0
            along = n0 * direction[0] + n2 * direction[2]
            for k in range(6):
                for l in range(6):
                    block[k, l] += stiff * n[k] * n[l]
            if geometric:
                h00, h02, h22 = hessian[f, q, 0, 0], hessian[f, q, 0, 2], hessian[f, q, 2, 2]
                turn = -p * area
                for a in range(3):
                    for b in range(3):
                        both = turn * N[q, a] * N[q, b]
                        bend = psi * two * r * dN[q, a] * dN[q, b] / length**3
                        ab, ba = psi * two * N[q, a] * dN[q, b] / length, psi * two * dN[q, a] * N[q, b] / length
                        block[2 * a, 2 * b] += both * h00 + bend * tz * tz + (ab + ba) * tr
                        block[2 * a, 2 * b + 1] += both * h02 - bend * tr * tz + ab * tz
                        block[2 * a + 1, 2 * b] += both * h02 - bend * tr * tz + ba * tz
                        block[2 * a + 1, 2 * b + 1] += both * h22 + bend * tr * tr
                for k in range(6):
                    for l in range(6):
                        block[k, l] -= p * (n[k] * da[l] + da[k] * n[l])
            for a in range(3):
                node = facets[f, a]
                rate0, rate2 = -stiff * along * n[2 * a], -stiff * along * n[2 * a + 1]
                if geometric:
                    turned = p * area * N[q, a]
                    rate0 += turned * (hessian[f, q, 0, 0] * direction[0] + hessian[f, q, 0, 2] * direction[2])
                    rate2 += turned * (hessian[f, q, 2, 0] * direction[0] + hessian[f, q, 2, 2] * direction[2])
                    rate0 += p * along * da[2 * a]
                    rate2 += p * along * da[2 * a + 1]
                moving[node, 0] += rate0
                moving[node, 2] += rate2
        if not touched:
            continue
        for k in range(6):
            row = 3 * (k // 2) + 2 * (k % 2)
            for l in range(6):
                at = place[f, row, 3 * (l // 2) + 2 * (l % 2)]
                if at >= 0:
                    data[at] += block[k, l]


@compiled()
def _normal(k, n, h, stiff, turn, geometric):  # type: ignore[no-untyped-def]
    """Fill k = stiff n⊗n + turn ∇∇g, the latter where it is `geometric`."""
    for i in range(3):
        for j in range(3):
            k[i, j] = stiff * n[i] * n[j]
            if geometric:
                k[i, j] += turn * h[i, j]


@compiled()
def _add(block, k, N, w):  # type: ignore[no-untyped-def]
    """Add w N_a N_b k to the block (3k, 3k) of a facet of k nodes."""
    for a in range(len(N)):
        for i in range(3):
            wa = w * N[a]
            for b in range(len(N)):
                for j in range(3):
                    block[3 * a + i, 3 * b + j] += wa * N[b] * k[i, j]


@compiled()
def _friction(k, n, h, square, along, size, t, v, p, e, stick, went, friction, bound, geometric):  # type: ignore[no-untyped-def]
    """k −= ∂t/∂x: sticking ∂t/∂x = −ε_T P − (n̂·v) M − n̂⊗(Mᵀv) − P w⊗n, M = ∂n̂/∂x, slipping cut to length μ_f p.

    n = ∇g need not have unit length; `along` is n·v/|n|²; w = ∂ε_T/∂g (Δx − Δc) where a gap closed in this step.
    """
    d, M = np.empty((3, 3)), np.zeros((3, 3))
    if geometric:
        for j in range(3):
            across = (n[0] * h[0, j] + n[1] * h[1, j] + n[2] * h[2, j]) / square
            for i in range(3):
                M[i, j] = h[i, j] - n[i] * across  # |n| ∂n̂/∂x
    gone = (went[0] * n[0] + went[1] * n[1] + went[2] * n[2]) / square
    for j in range(3):
        turned = (v[0] * M[0, j] + v[1] * M[1, j] + v[2] * M[2, j]) / square
        for i in range(3):
            P = (1.0 if i == j else 0.0) - n[i] * n[j] / square
            d[i, j] = -stick * P - along * M[i, j] - n[i] * turned - (went[i] - n[i] * gone) * n[j]
    limit = bound if bound >= 0.0 else friction * p
    growth = 0.0 if bound >= 0.0 else friction * e
    if size <= limit:
        for i in range(3):
            for j in range(3):
                k[i, j] -= d[i, j]
        return
    for j in range(3):
        along_t = (t[0] * d[0, j] + t[1] * d[1, j] + t[2] * d[2, j]) / (size * size)
        for i in range(3):
            k[i, j] -= limit / size * (d[i, j] - t[i] * along_t) - growth * t[i] / size * n[j]
