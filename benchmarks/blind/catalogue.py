"""What can be wrong with a synthetic experiment: names, own ranges (log-uniform), and the verdicts allowed.

`draw(name, rng)` -> dict with
    truth   the parameters as they are published in the sealed file (N, mm, MPa, s, degrees)
    model   changes of `fe.Model` as a function of (mu, D1)
    chain   changes of the measurement chain or of the test plan, see `experiment.py`; TURNED: where the sphere goes
    answers names a diagnosis may give for it (the product's own names, a published interface; nothing is imported)
    size    the main number, or None
"""

import numpy as np


def log_uniform(rng, low, high):
    """exp of a uniform number between ln low and ln high."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def signed(rng, low, high):
    """Log-uniform size with a random sign."""
    return float(rng.choice([-1, 1])) * log_uniform(rng, low, high)


ANSWERS = {  # truth name -> names accepted as the right cause (equivalent by definition, not by similarity)
    "yeoh": {"C20", "C30"},
    "ogden": {"alpha"},
    "prony": {"prony_g", "prony_tau"},
    "mullins": {"mullins", "mullins_r", "mullins_m"},
    "fibre_x": {"fibre", "fibre_k1", "fibre_angle"},
    "fibre_y": {"fibre", "fibre_k1", "fibre_angle"},
    "skin_stiff": {"skin_ratio", "skin_thickness"},
    "skin_soft": {"skin_ratio", "skin_thickness"},
    "inclusion_stiff": {"inclusion_ratio"},
    "inclusion_soft": {"inclusion_ratio"},
    "cavity": {"cavity", "cavity_a", "cavity_b", "cavity_c", "inclusion_ratio"},
    "delta_a": {"delta_a"},
    "delta_b": {"delta_b"},
    "delta_c": {"delta_c"},
    "delta_R": {"delta_R"},
    "weight": {"weight"},
    "friction": {"friction"},
    "adhesion": {"adhesion"},
    "bowl": {"bowl_clearance", "bowl", "support"},
    "offset_x": {"offset_x"},
    "offset_y": {"offset_y"},
    "tilt_x": {"tilt_x"},
    "tilt_y": {"tilt_y"},
    "offset": {"offset"},
    "offset_each": {"offset"},
    "compliance": {"compliance"},
    "gain": {"gain"},
    "bias": {"bias"},
    "drift": {"drift"},
    "lag": {"lag"},
    "cross_x": {"cross_x"},
    "cross_y": {"cross_y"},
}
CHAIN = ("offset", "offset_each", "compliance", "gain", "bias", "drift", "lag", "cross_x", "cross_y")
TURNED = ("offset_x", "offset_y", "tilt_x", "tilt_y")  # see `solve.turned`
FREE = (*CHAIN, *TURNED)  # leave the tables of other effects as they are
SINGLE = tuple(ANSWERS)

U = ("unexplained", "partly")
OUTSIDE = {  # name -> (verdicts allowed, causes with which "explained" or "ambiguous" is also allowed)
    "stick_slip": (U, ()),
    "clipping": ((*U, "measurement"), ()),
    "swapped_file": ((*U, "measurement"), ()),
    "wrong_point": ((*U, "measurement"), ()),
    "gradient": ((*U, "ambiguous"), ("skin_ratio",)),
    "fractional": (U, ("prony_g",)),
    "temperature": (U, ("mullins", "gain")),
    "rocking": ((*U, "ambiguous"), ("bowl_clearance", "bowl")),
    "set": (U, ("mullins",)),
    "backlash": ((*U, "measurement"), ()),
    "depth_scale": ((*U, "measurement"), ()),
    "spikes": ((*U, "measurement", "no_gap"), ()),
    "nonlinear_cell": ((*U, "measurement", "ambiguous"), ()),
    "hum": ((*U, "measurement", "no_gap"), ()),
    "screw_error": ((*U, "measurement"), ()),
    "lint": ((*U, "measurement", "ambiguous"), ("offset", "skin_ratio", "skin_thickness")),
    "parallel_spring": ((*U, "measurement", "ambiguous"), ()),
    "poroelastic": ((*U, "ambiguous"), ("prony_g", "prony_tau")),
    "tear": (U, ()),
    "cell_hysteresis": ((*U, "measurement"), ()),
    "recovery": ((*U, "ambiguous"), ("mullins", "mullins_r", "mullins_m")),
    "collar": ((*U, "measurement"), ()),
    "glue": ((*U, "measurement"), ()),
}
LISTED = {  # outside kinds that the diagnosis holds in its catalogue by the fourteenth round, by its names for them
    "temperature": ("ageing",),
    "wrong_point": ("offset_x", "offset_x at (20, 0)"),
    "rocking": ("compliance at (20, 0)", "compliance"),
    "set": ("permanent_set",),
    "backlash": ("backlash",),
    "depth_scale": ("depth_scale",),
    "nonlinear_cell": ("nonlinearity",),
    "glue": ("creep", "compliance"),
}


def effect(size, truth, model=None, chain=None):
    """What `draw` returns, but for the name."""
    return {"size": size, "truth": truth, "model": model or {}, "chain": chain or {}}


def yeoh(rng):
    """Two moduli of higher order."""
    c20 = log_uniform(rng, 0.005, 0.15)
    c30 = c20 * float(rng.choice([0.0, 0.05, 0.15]))
    return effect(c20, {"C20_over_mu": c20, "C30_over_mu": c30}, {"c20": c20, "c30": c30})


def ogden(rng):
    """One term; 2 is neo-Hookean."""
    alpha = float(rng.choice([1.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0]))
    return effect(alpha, {"alpha": alpha}, {"alpha": alpha})


def prony(rng):
    """One relaxation time."""
    g, tau = log_uniform(rng, 0.05, 0.4), log_uniform(rng, 0.3, 60.0)
    return effect(g, {"prony_g": g, "prony_tau_s": tau}, {"prony": [[g, tau]]})


def fractional(rng):
    """A power law of time: equal weights on logarithmic times."""
    g, times = log_uniform(rng, 0.15, 0.5), [0.1, 1.0, 10.0, 100.0]
    return effect(g, {"g": g, "tau_s": times}, {"prony": [[g / 4, t] for t in times]})


def mullins(rng):
    """Softening by the largest energy so far."""
    size, beta, m0 = log_uniform(rng, 0.05, 0.5), float(rng.uniform(0.1, 0.6)), log_uniform(rng, 0.02, 0.2)
    return effect(size, {"softening": size, "beta": beta, "m_over_mu": m0}, {"mullins": [1 / size, beta, m0]})


def fibre(rng, axis):
    """Fibres along x (0) or y (1)."""
    k = log_uniform(rng, 0.05, 2.0)
    return effect(k, {"fibre_k_over_mu": k}, {"fibre": k, "fibre_axis": axis})


def skin(rng, ratio):
    """A layer with `ratio` times the moduli."""
    model = {"skin_ratio": ratio, "skin_thickness": log_uniform(rng, 0.3, 1.5)}
    return effect(ratio, dict(model), model)


def blob(rng, ratio, by_radius=False):
    """A sphere of other moduli below the surface; `by_radius`: its radius is its size."""
    r, gap, x = log_uniform(rng, 2.5, 8.0), log_uniform(rng, 2.0, 12.0), float(rng.choice([0.0, 0.0, 8.0, 16.0]))
    top = 35 * np.sqrt(1 - (x / 60) ** 2)
    return effect(
        r if by_radius else ratio,
        {"ratio": ratio, "radius_mm": r, "gap_below_surface_mm": gap, "x_mm": x},
        {"blob_ratio": ratio, "blob_radius": r, "blob_centre": [x, 0.0, float(top - gap - r)]},
    )


def semi_axis(rng, k):
    """Semi-axis k of the body, longer or shorter."""
    size, axes = signed(rng, 0.3, 5.0), [1.0, 1.0, 1.0]
    axes[k] += size / (60.0, 35.0, 35.0)[k]
    return effect(size, {"delta_mm": size}, {"axes": axes})


def radius(rng):
    """Radius of the sphere."""
    size = signed(rng, 0.03, 0.5)
    return effect(size, {"delta_mm": size}, {"radius": 3.0 + size})


def weight(rng):
    """Specific weight."""
    size = log_uniform(rng, 3e-6, 2e-5)
    return effect(size, {"specific_weight_N_per_mm3": size}, {"weight_mpa": size})


def friction(rng):
    """Coulomb's coefficient at the indenter."""
    size = log_uniform(rng, 0.03, 0.8)
    return effect(size, {"mu_f": size}, {"friction": size})


def adhesion(rng):
    """Work and range of an attraction."""
    work, length = log_uniform(rng, 5e-6, 5e-4), float(rng.uniform(0.1, 0.3))
    return effect(work, {"work_N_per_mm": work, "range_mm": length}, {"adhesion_mpa": work, "adhesion_range": length})


def bowl(rng):
    """A bowl instead of a held surface."""
    size, mu = log_uniform(rng, 0.2, 3.0), float(rng.uniform(0.05, 0.5))
    return effect(size, {"clearance_mm": size, "mu_platform": mu}, {"bowl": size, "bowl_friction": mu})


def gradient(rng):
    """A modulus that changes with the depth."""
    size = signed(rng, 0.1, 1.0)
    return effect(size, {"log_modulus_per_10_mm_depth": size}, {"gradient": size})


def offset_each(rng):
    """A contact point of its own in every test."""
    sd = log_uniform(rng, 0.02, 0.2)
    return effect(sd, {"offset_sd_mm": sd}, chain={"offsets": [float(v) for v in rng.normal(0, sd, 12)]})


def gain(rng):
    """A wrong factor on all forces."""
    size = 1 + signed(rng, 0.01, 0.12)
    return effect(size, {"gain": size}, chain={"gain": size})


KINDS = {  # mechanics, and what is more than one number of the measurement chain
    "yeoh": yeoh,
    "ogden": ogden,
    "prony": prony,
    "fractional": fractional,
    "mullins": mullins,
    "fibre_x": lambda rng: fibre(rng, 0),
    "fibre_y": lambda rng: fibre(rng, 1),
    "skin_stiff": lambda rng: skin(rng, log_uniform(rng, 1.15, 6.0)),
    "skin_soft": lambda rng: skin(rng, 1 / log_uniform(rng, 1.15, 4.0)),
    "inclusion_stiff": lambda rng: blob(rng, log_uniform(rng, 2, 30)),
    "inclusion_soft": lambda rng: blob(rng, 1 / log_uniform(rng, 2, 30)),
    "cavity": lambda rng: blob(rng, 0.01, by_radius=True),
    "delta_a": lambda rng: semi_axis(rng, 0),
    "delta_b": lambda rng: semi_axis(rng, 1),
    "delta_c": lambda rng: semi_axis(rng, 2),
    "delta_R": radius,
    "weight": weight,
    "friction": friction,
    "adhesion": adhesion,
    "bowl": bowl,
    "gradient": gradient,
    "offset_each": offset_each,
    "gain": gain,
}
EITHER, UP, EVEN = signed, log_uniform, lambda rng, low, high: float(rng.uniform(low, high))
SIZES = {  # the others are one number of the chain or of the plan: how it is drawn, from, to
    "offset": (EITHER, 0.005, 0.3),  # mm
    "compliance": (UP, 0.02, 0.6),  # mm/N
    "bias": (EITHER, 5e-4, 3e-2),  # N
    "drift": (EITHER, 2e-5, 5e-3),  # N/s
    "lag": (UP, 0.005, 1.0),  # s
    "cross_x": (EITHER, 0.001, 0.1),
    "cross_y": (EITHER, 0.001, 0.1),
    "offset_x": (EITHER, 0.1, 3.0),  # mm
    "offset_y": (EITHER, 0.1, 3.0),
    "tilt_x": (EITHER, 0.1, 5.0),  # degrees
    "tilt_y": (EITHER, 0.1, 5.0),
    "stick_slip": (UP, 0.03, 0.25),  # share of the force lost in a slip
    "clipping": (EVEN, 0.5, 0.92),  # of the largest force of the plan
    "swapped_file": (EVEN, 1.0, 1.0),
    "wrong_point": (EVEN, 6, 14),  # mm, where "20_0" really was
    "temperature": (EITHER, 0.04, 0.3),  # share of the modulus over the whole plan
    "rocking": (UP, 0.1, 1.5),  # extra compliance at x = 20 mm, mm/N
    "set": (UP, 0.02, 0.15),  # share of the depth that stays
    "backlash": (UP, 0.05, 0.3),  # mm
    "depth_scale": (EITHER, 0.02, 0.12),
    "spikes": (EVEN, 0.03, 0.1),  # share of the samples
    "nonlinear_cell": (EITHER, 0.05, 0.5),  # 1/N
    "hum": (UP, 0.004, 0.03),  # N
    "screw_error": (UP, 0.005, 0.08),  # mm
    "lint": (UP, 0.03, 0.5),  # mm
    "parallel_spring": (UP, 1e-3, 6e-2),  # N/mm
    "poroelastic": (UP, 0.01, 0.4),  # overstress 1 - 2 nu of the drained solid
    "tear": (UP, 0.005, 0.3),  # share of the force lost
    "cell_hysteresis": (UP, 0.003, 0.08),  # height of the loop over the peak force
    "recovery": (UP, 0.02, 0.3),  # share of the force lost right after a test
    "glue": (UP, 0.03, 0.8),  # mm/N in the end
    "collar": (UP, 0.003, 0.3),  # share of the force 1 mm beyond the depth where it touches
}
BESIDE = {  # name -> (key of the chain, key of the truth, how it is drawn) of further numbers
    "stick_slip": [("stick_slip_period", "period_mm", lambda rng: float(rng.uniform(0.25, 0.9)))],
    "hum": [("hum_period", "period_s", lambda rng: float(rng.uniform(0.5, 4.0)))],
    "screw_error": [
        ("screw_pitch", "pitch_mm", lambda rng: float(rng.choice([0.5, 1.0, 1.5, 2.0]))),
        ("screw_phase", "phase", lambda rng: float(rng.uniform(0, 2 * np.pi))),
    ],
    "lint": [("lint_force", "force_N", lambda rng: log_uniform(rng, 0.002, 0.02))],
    "poroelastic": [("poroelastic_time", "time_at_4_mm_s", lambda rng: log_uniform(rng, 2.0, 60.0))],
    "tear": [("tear_depth", "depth_mm", lambda rng: float(rng.uniform(4.1, 5.2)))],
    "recovery": [
        ("recovery_time", "time_s", lambda rng: log_uniform(rng, 60.0, 400.0)),
        ("recovery_rests", "rests_s", lambda rng: [log_uniform(rng, 20.0, 900.0) for _ in range(11)]),
    ],
    "glue": [("glue_time", "time_s", lambda rng: log_uniform(rng, 1.0, 60.0))],
    "collar": [("collar_depth", "depth_mm", lambda rng: float(rng.uniform(2.5, 4.5)))],
}


def of_chain(name, rng):
    """A number of the measurement chain or of the plan, and what goes with it."""
    how, low, high = SIZES[name]
    size = how(rng, low, high)
    beside = [(key, said, drawn(rng)) for key, said, drawn in BESIDE.get(name, ())]
    chain = {name: size} | {key: value for key, _, value in beside}
    return effect(size, {name: size} | {said: value for _, said, value in beside}, chain=chain)


def draw(name, rng):
    """Sizes of one effect; see the module's docstring for what comes back."""
    return {"name": name} | (KINDS[name](rng) if name in KINDS else of_chain(name, rng))
