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
}
LISTED = {  # outside kinds that the diagnosis's catalogue holds by the eighth round, by its names for the same thing
    "temperature": ("ageing",),
    "wrong_point": ("offset_x", "offset_x at (20, 0)"),
    "rocking": ("compliance at (20, 0)", "compliance"),
    "set": ("permanent_set",),
    "backlash": ("backlash",),
}


def draw(name, rng):
    """Sizes of one effect; see the module's docstring for what comes back."""
    lu, sg = (lambda a, b: log_uniform(rng, a, b)), (lambda a, b: signed(rng, a, b))
    truth, model, chain = {}, {}, {}
    if name == "yeoh":
        c20 = lu(0.005, 0.15)
        model = {"c20": c20, "c30": c20 * float(rng.choice([0.0, 0.05, 0.15]))}
        truth = {"C20_over_mu": c20, "C30_over_mu": model["c30"]}
        size = c20
    elif name == "ogden":
        size = float(rng.choice([1.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0]))
        model, truth = {"alpha": size}, {"alpha": size}
    elif name in ("prony", "fractional"):
        g, tau = lu(0.05, 0.4), lu(0.3, 60.0)
        if name == "fractional":  # power law: equal weights on logarithmic times
            g = lu(0.15, 0.5)
            model = {"prony": [[g / 4, t] for t in (0.1, 1.0, 10.0, 100.0)]}
            truth = {"g": g, "tau_s": [0.1, 1.0, 10.0, 100.0]}
        else:
            model, truth = {"prony": [[g, tau]]}, {"prony_g": g, "prony_tau_s": tau}
        size = g
    elif name == "mullins":
        size, beta, m0 = lu(0.05, 0.5), float(rng.uniform(0.1, 0.6)), lu(0.02, 0.2)
        model = {"mullins": [1 / size, beta, m0]}
        truth = {"softening": size, "beta": beta, "m_over_mu": m0}
    elif name in ("fibre_x", "fibre_y"):
        size = lu(0.05, 2.0)
        model, truth = {"fibre": size, "fibre_axis": int(name == "fibre_y")}, {"fibre_k_over_mu": size}
    elif name in ("skin_stiff", "skin_soft"):
        size = lu(1.15, 6.0) if name == "skin_stiff" else 1 / lu(1.15, 4.0)
        model = {"skin_ratio": size, "skin_thickness": lu(0.3, 1.5)}
        truth = dict(model)
    elif name in ("inclusion_stiff", "inclusion_soft", "cavity"):
        size = {"inclusion_stiff": lu(2, 30), "inclusion_soft": 1 / lu(2, 30), "cavity": 0.01}[name]
        r, gap, x = lu(2.5, 8.0), lu(2.0, 12.0), float(rng.choice([0.0, 0.0, 8.0, 16.0]))
        top = 35 * np.sqrt(1 - (x / 60) ** 2)
        model = {"blob_ratio": size, "blob_radius": r, "blob_centre": [x, 0.0, float(top - gap - r)]}
        truth = {"ratio": size, "radius_mm": r, "gap_below_surface_mm": gap, "x_mm": x}
        size = r if name == "cavity" else size
    elif name in ("delta_a", "delta_b", "delta_c"):
        k = "abc".index(name[-1])
        size = sg(0.3, 5.0)
        axes = [1.0, 1.0, 1.0]
        axes[k] += size / (60.0, 35.0, 35.0)[k]
        model, truth = {"axes": axes}, {"delta_mm": size}
    elif name == "delta_R":
        size = sg(0.03, 0.5)
        model, truth = {"radius": 3.0 + size}, {"delta_mm": size}
    elif name == "weight":
        size = lu(3e-6, 2e-5)
        model, truth = {"weight_mpa": size}, {"specific_weight_N_per_mm3": size}
    elif name == "friction":
        size = lu(0.03, 0.8)
        model, truth = {"friction": size}, {"mu_f": size}
    elif name == "adhesion":
        size = lu(5e-6, 5e-4)
        model = {"adhesion_mpa": size, "adhesion_range": float(rng.uniform(0.1, 0.3))}
        truth = {"work_N_per_mm": size, "range_mm": model["adhesion_range"]}
    elif name == "bowl":
        size = lu(0.2, 3.0)
        model = {"bowl": size, "bowl_friction": float(rng.uniform(0.05, 0.5))}
        truth = {"clearance_mm": size, "mu_platform": model["bowl_friction"]}
    elif name == "gradient":
        size = sg(0.1, 1.0)
        model, truth = {"gradient": size}, {"log_modulus_per_10_mm_depth": size}
    elif name == "offset_each":
        size = lu(0.02, 0.2)
        chain = {"offsets": [float(v) for v in rng.normal(0, size, 12)]}
        truth = {"offset_sd_mm": size}
    elif name == "gain":
        size = 1 + sg(0.01, 0.12)
        chain, truth = {"gain": size}, {"gain": size}
    else:
        simple = {
            "offset": lambda: sg(0.005, 0.3),  # mm
            "compliance": lambda: lu(0.02, 0.6),  # mm/N
            "bias": lambda: sg(5e-4, 3e-2),  # N
            "drift": lambda: sg(2e-5, 5e-3),  # N/s
            "lag": lambda: lu(0.005, 1.0),  # s
            "cross_x": lambda: sg(0.001, 0.1),
            "cross_y": lambda: sg(0.001, 0.1),
            "offset_x": lambda: sg(0.1, 3.0),  # mm
            "offset_y": lambda: sg(0.1, 3.0),
            "tilt_x": lambda: sg(0.1, 5.0),  # degrees
            "tilt_y": lambda: sg(0.1, 5.0),
            "stick_slip": lambda: lu(0.03, 0.25),  # share of the force lost in a slip
            "clipping": lambda: float(rng.uniform(0.5, 0.92)),  # of the largest force of the plan
            "swapped_file": lambda: 1.0,
            "wrong_point": lambda: float(rng.uniform(6, 14)),  # mm, where "20_0" really was
            "temperature": lambda: sg(0.04, 0.3),  # share of the modulus over the whole plan
            "rocking": lambda: lu(0.1, 1.5),  # extra compliance at x = 20 mm, mm/N
            "set": lambda: lu(0.02, 0.15),  # share of the depth that stays
            "backlash": lambda: lu(0.05, 0.3),  # mm
            "depth_scale": lambda: sg(0.02, 0.12),
            "spikes": lambda: float(rng.uniform(0.03, 0.1)),  # share of the samples
            "nonlinear_cell": lambda: sg(0.05, 0.5),  # 1/N
            "hum": lambda: lu(0.004, 0.03),  # N
            "screw_error": lambda: lu(0.005, 0.08),  # mm
            "lint": lambda: lu(0.03, 0.5),  # mm
            "parallel_spring": lambda: lu(1e-3, 6e-2),  # N/mm
            "poroelastic": lambda: lu(0.01, 0.4),  # overstress 1 - 2 nu of the drained solid
            "tear": lambda: lu(0.005, 0.3),  # share of the force lost
            "cell_hysteresis": lambda: lu(0.003, 0.08),  # height of the loop over the peak force
            "recovery": lambda: lu(0.02, 0.3),  # share of the force lost right after a test
            "collar": lambda: lu(0.003, 0.3),  # share of the force 1 mm beyond the depth where it touches
        }
        size = simple[name]()
        chain, truth = {name: size}, {name: size}
        if name == "stick_slip":
            chain["stick_slip_period"] = truth["period_mm"] = float(rng.uniform(0.25, 0.9))
        if name == "hum":
            chain["hum_period"] = truth["period_s"] = float(rng.uniform(0.5, 4.0))
        if name == "screw_error":
            chain["screw_pitch"] = truth["pitch_mm"] = float(rng.choice([0.5, 1.0, 1.5, 2.0]))
            chain["screw_phase"] = truth["phase"] = float(rng.uniform(0, 2 * np.pi))
        if name == "lint":
            chain["lint_force"] = truth["force_N"] = lu(0.002, 0.02)
        if name == "poroelastic":
            chain["poroelastic_time"] = truth["time_at_4_mm_s"] = lu(2.0, 60.0)
        if name == "tear":
            chain["tear_depth"] = truth["depth_mm"] = float(rng.uniform(4.1, 5.2))
        if name == "recovery":
            chain["recovery_time"] = truth["time_s"] = lu(60.0, 400.0)
            chain["recovery_rests"] = truth["rests_s"] = [lu(20.0, 900.0) for _ in range(11)]
        if name == "collar":
            chain["collar_depth"] = truth["depth_mm"] = float(rng.uniform(2.5, 4.5))
    return {"name": name, "size": size, "truth": truth, "model": model, "chain": chain}
