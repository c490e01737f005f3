"""A diagnosis as plain data, made by formulas: the layout that `rso.discrepancy.diagnosis_results` writes."""

import json

import numpy as np

VERDICTS = ("no_gap", "explained", "ambiguous", "partly", "unexplained", "measurement")
EFFECTS = [  # name, description, family, unit, neutral, low, high, smallest visible, confused with
    ("C20", "Yeoh C20, strain stiffening", "model", "MPa", 0.0, 1e-4, 4e-3, 2.1e-4, ["alpha"]),
    ("alpha", "Ogden exponent (one term)", "model", "1", 2.0, 0.8, 12.0, 2.9, ["C20"]),
    ("prony_g", "relaxing share of the shear modulus, first term", "model", "1", 0.0, 0.03, 0.6, 0.031, []),
    ("mullins", "largest Mullins softening, 1/r of Ogden-Roxburgh", "model", "1", 0.0, 0.03, 0.6, 0.06, ["prony_g"]),
    ("skin_ratio", "stiffness of the skin over that of the core", "model", "1", 1.0, 0.2, 5.0, 1.34, ["cavity"]),
    ("cavity", "size of the cavity below over that of the settings", "model", "1", 0.0, 0.3, 1.5, 0.82, ["skin_ratio"]),
    ("friction", "Coulomb friction between indenter and body", "model", "1", 0.0, 0.03, 1.0, 0.14, ["adhesion"]),
    ("adhesion", "work of adhesion", "model", "N/mm", 0.0, 1e-3, 0.2, 4e-3, ["friction", "offset"]),
    ("delta_R", "error of the indenter radius", "model", "mm", 0.0, -0.3, 0.3, 0.11, ["offset", "gain"]),
    ("offset_x", "misalignment of the indenter in x", "model", "mm", 0.0, -2.0, 2.0, 0.23, ["tilt_y"]),
    ("tilt_y", "specimen turned about y", "model", "deg", 0.0, -6.0, 6.0, 0.7, ["offset_x"]),
    ("weight", "specific weight, density times g", "model", "N/mm^3", 0.0, 1e-7, 4e-6, None, []),
    ("bowl_clearance", "bowl: semi-axes of the bowl minus those of the body", "model", "mm", None, 0.2, 4.0, None, []),
    (
        "offset",
        "true depth at which the record says zero (above 0: contact was taken late, below: early)",
        "measurement",
        "mm",
        0.0,
        -0.4,
        0.4,
        0.037,
        ["delta_R"],
    ),
    ("compliance", "load-train compliance", "measurement", "mm/N", 0.0, 0.01, 0.8, 0.05, ["prony_g"]),
    ("gain", "gain of the force channel", "measurement", "1", 1.0, 0.8, 1.25, None, []),
    ("bias", "zero error of the force channel", "measurement", "N", 0.0, -0.05, 0.05, 1.3e-3, []),
    ("drift", "drift of the force channel", "measurement", "N/s", 0.0, -4e-3, 4e-3, 6e-5, []),
    ("cross_x", "share of Fz that appears in Fx", "measurement", "1", 0.0, -0.2, 0.2, 0.004, ["offset_x"]),
]
TESTS = [  # name, role, point, speed mm/s, deepest mm, unloads, repeats
    ("middle", "fit", [0.0, 0.0], 0.5, 4.0, False, 3),
    ("cycle_10", "fit", [0.0, 0.0], 10 / 60, 4.0, True, 1),
    ("cycle_100", "fit", [0.0, 0.0], 100 / 60, 4.0, True, 1),
    ("aside", "select", [20.0, 0.0], 0.5, 4.0, False, 2),
    ("deep", "validate", [0.0, 0.0], 0.5, 8.0, False, 1),
]
LEADING = {
    "no_gap": (),
    "explained": ("prony_g",),
    "ambiguous": ("friction", "adhesion"),
    "partly": ("skin_ratio",),
    "unexplained": (),
    "measurement": ("compliance",),
}
SIZE = {
    "prony_g": (0.21, 0.17, 0.25),
    "friction": (0.31, 0.22, 0.46),
    "adhesion": (0.011, 0.007, 0.016),
    "skin_ratio": (2.4, 1.7, 3.3),
    "compliance": (0.13, 0.10, 0.16),
}


def story(verdict="explained", seed=0):
    """Everything that a diagnosis with this verdict writes; numbers are plausible, not computed from any model."""
    rng = np.random.default_rng(seed)
    named, gap = LEADING[verdict], verdict != "no_gap"
    chosen = {"unexplained": "none + unexplained", "partly": "skin_ratio + unexplained"}.get(verdict) or (
        named or ("none",)
    )[0]
    p = 0.43 if verdict == "no_gap" else 1 / 401
    d = {
        "verdict": verdict,
        "gap": {
            "p_value": p,
            "size_over_noise": 2.31 if gap else 1.02,
            "statistic": 41.2 if gap else -1.1,
            "threshold": 1.7,
        },
        "where": _where(gap),
        "where_threshold": 3.1,
        "causes": [_cause(n, 0.95 if len(named) == 1 else (0.56, 0.41)[k]) for k, n in enumerate(named)],
        "chosen": [n for n in chosen.split(" + ") if n not in ("none", "unexplained")],
        "ambiguous_with": [list(named)] if verdict == "ambiguous" else [],
        "shrinkage": _shrinkage(verdict),
        "parameters": {
            "before": {"mu": _span(0.0103, 0.0099, 0.0107), "D1": _span(22.0, 8.0, 61.0)},
            "after": {"mu": _span(0.0118, 0.0112, 0.0124), "D1": _span(9.0, 3.1, 27.0)},
        },
        "detectable": [_detectable(*e) for e in EFFECTS],
        "next_test": _next(named),
    }
    finalists = [*named, *[n for n in ("prony_g", "mullins", "C20", "skin_ratio") if n not in named]][:3]
    residuals = _residuals(rng, gap, chosen)
    return {
        "schema": 1,
        "title": "Ultra-soft polyurethane kidney, EM II",
        "diagnosis": d,
        "experiments": [
            {
                "name": n,
                "role": role,
                "channels": ["Fx", "Fz"],
                "speed": v,
                "mounting": "A",
                "repeats": r,
                "kind": "force",
                "point": point,
            }
            for n, role, point, v, _, _, r in TESTS
        ]
        + [
            {
                "name": "profile",
                "role": "fit",
                "channels": ["uz"],
                "speed": 0.5,
                "mounting": "A",
                "repeats": 1,
                "kind": "profile",
                "point": [0.0, 0.0],
            }
        ],
        "noise": {
            "Fz": {
                "white": 2.1e-3,
                "correlated": 1.2e-3,
                "length_mm": 0.3,
                "gain": 0.011,
                "contact_mm": 0.03,
                "depth_mm": 0.01,
                "source": "repeats",
            },
            "Fx": {
                "white": 2.0e-3,
                "correlated": 0.0,
                "length_mm": 0.3,
                "gain": 0.011,
                "contact_mm": 0.03,
                "depth_mm": 0.01,
                "source": "stated",
            },
            "uz": {
                "white": 0.02,
                "correlated": 0.0,
                "length_mm": 5.0,
                "gain": 0.0,
                "contact_mm": 0.03,
                "depth_mm": 0.0,
                "source": "stated",
            },
        },
        "effects": [
            {
                "name": e[0],
                "description": e[1],
                "family": e[2],
                "unit": e[3],
                "neutral": e[4],
                "low": e[5],
                "high": e[6],
                "shape": ["prony_tau"] if e[0] == "prony_g" else [],
            }
            for e in EFFECTS
        ],
        "probabilities": _probabilities(verdict, named),
        "sensitivity": {
            "halved": _merged(_probabilities(verdict, named, 0.9)),
            "doubled": _merged(_probabilities(verdict, named, 1.3)),
        },
        "held_out": [
            {"experiment": n, "gain": {"none": 0.0, **{f: g * (1 - 0.9 * k) for k, f in enumerate(finalists)}}}
            for n, g in (("middle", 3.1), ("cycle_10", 14.2), ("cycle_100", 19.7), ("aside", -0.4), ("profile", 0.1))
        ],
        "checks": [
            {"hypothesis": h, "returned": r, "in_set": s, "no_gap": n, "n": m}
            for h, r, s, n, m in [
                ("none", 0.95, 0.95, 0.95, 400),
                (finalists[0], 0.93, 0.98, 0.0, 60),
                (finalists[1], 0.85, 0.97, 0.03, 60),
            ]
        ]
        if gap
        else [],
        "power": [{"effect": e[0], "power": _power(e, k)} for k, e in enumerate(EFFECTS)],
        "residuals": residuals,
        "signatures": _signatures(residuals, named, chosen),
        "rerun": [{"runs": 2, "failed": 0, "largest": 0.0061, "rms": 0.0024, "effects": ["C20"]}]
        if verdict == "explained"
        else [],
        "failed_runs": ["cavity at [20.0, 0.0]: Newton did not converge at 3.1 mm"],
        "notes": ["cycle_10: 12 readings of a hold are not used"],
        "words": _words(verdict, named),
        "timings": {"library_wall": 612.0, "library_cpu": 1108.0, "library_runs": 214, "judging_cpu": 48.0},
        "command": "rso diagnose study.toml",
    }


def read_back(found):
    """As it is read from diagnosis.json."""
    return json.loads(json.dumps(found, allow_nan=False))


def _span(median, low, high):
    return {"low": low, "median": median, "high": high}


def _where(gap):
    rows = [
        ("cycle_100", "Fz", "loading 2.7–4.0 mm", 9.4, 0.061, 0.0065),
        ("cycle_10", "Fz", "unloading 2.0–4.0 mm", -6.2, -0.043, 0.007),
        ("cycle_10", "Fz", "loading 1.3–2.7 mm", -3.6, -0.019, 0.0053),
        ("aside", "Fz", "loading 0.0–1.3 mm", 1.9, 0.03, 0.016),
        ("profile", "uz", "profile at 4 mm", 1.1, 0.02, 0.018),
        ("middle", "Fx", "loading 0.0–1.3 mm", -0.8, -0.1, 0.13),
    ]
    return [
        {
            "experiment": e,
            "channel": c,
            "region": r,
            "z": z if gap else z / 9,
            "sign": "+" if z > 0 else "-",
            "amplitude": a,
            "amplitude_sd": s,
            "beyond_noise": gap and abs(z) > 3.1,
            "share": z**2 / 143.0 if gap else 0.0,
        }
        for e, c, r, z, a, s in rows
    ]


def _cause(name, probability):
    e = next(e for e in EFFECTS if e[0] == name)
    size, low, high = SIZE[name]
    return {
        "effect": name,
        "description": e[1],
        "family": e[2],
        "probability": probability,
        "size": size,
        "interval": [low, high],
        "unit": e[3],
        "neutral": e[4],
        "railed": False,
    }


def _shrinkage(verdict):
    curves = [
        ("deep", "N", 11.2, 7.4, 1.31, [0.0410, 0.0301, 0.0092]),
        ("profile at rest", "mm", 1.4, 1.3, 1.2, [0.03, 0.029, 0.027]),
    ]
    if verdict in ("no_gap", "unexplained"):
        curves = [(c, u, 1.05, 1.02, 1.02, [0.009] * 3) for c, u, *_ in curves]
    mean = np.mean([c[2:5] for c in curves], axis=0)
    closed = None if verdict in ("no_gap", "unexplained") else float((mean[0] - mean[2]) / (mean[0] - 1))
    return {
        "held_out": [c[0] for c in curves],
        "before": mean[0],
        "refit_only": mean[1],
        "with_cause": mean[2],
        "noise_floor": 1.0,
        "floor_error": 0.12,
        "closed": closed,
        "interval": None if closed is None else [0.81, 0.99],
        "how": "validate curves",
        "curves": [
            dict(zip(("curve", "unit", "before", "refit_only", "with_cause", "rms"), c, strict=True)) for c in curves
        ],
    }


def _detectable(name, description, family, unit, neutral, low, high, limit, confused):
    return {
        "effect": name,
        "unit": unit,
        "smallest_visible": limit,
        "visible": limit is not None or name == "bowl_clearance",
        "confused_with": confused,
        "confounded_with": confused,
        "recognised": 0.9 - 0.25 * len(confused),
    }


def _power(e, k):
    s = np.geomspace(0.03, 1.0, 8) * max(abs(e[5]), abs(e[6]))
    limit = 0.01 if e[4] is None else 100.0 if e[7] is None else 0.05 * 1.12**k
    return [(float(x), float(1 / (1 + (limit / y) ** 3))) for x, y in zip(s, s / s[-1], strict=True)]


def _next(named):
    if len(named) < 2:
        return []
    return [
        {
            "test": t,
            "chance": min(D / 5, 1.0),
            "separates": list(named),
            "distance": D,
            "resolves": int(D >= 4),
            "pairs": 1,
        }
        for t, D in (
            ("the same test with the surface wetted", 11.3),
            ("load and unload ten times slower (1 mm/min)", 3.2),
            ("a ball of 6 mm radius", 2.1),
            ("press a rigid block", 0.0),
        )
    ]


def _probabilities(verdict, named, q=1.0):
    if verdict == "no_gap":
        return {"none": 0.91, "gain": 0.03, "bias": 0.02, "none + unexplained": 0.015, "offset": 0.01, "drift": 0.008}
    weights = {n: w * q for n, w in zip(named, (9.0, 6.5), strict=False)}
    if verdict == "partly":
        weights = {"skin_ratio + unexplained": 8.0, "skin_ratio": 0.9}
    if verdict == "unexplained":
        weights = {"none + unexplained": 8.0}
    weights |= {"mullins": 0.4, "prony_g + friction": 0.2, "none + unexplained": weights.get("none + unexplained", 0.1)}
    weights |= {"C20": 0.01, "none": 1e-9}
    total = sum(weights.values())
    return dict(sorted(((k, v / total) for k, v in weights.items()), key=lambda v: -v[1]))


def _merged(probabilities):
    """An effect with and without something unexplained as one."""
    found = {}
    for name, q in probabilities.items():
        key = name if name.startswith("none") else name.removesuffix(" + unexplained")
        found[key] = found.get(key, 0.0) + q
    return dict(sorted(found.items(), key=lambda v: -v[1])[:5])


def _residuals(rng, gap, chosen):
    found = []
    for name, role, _, speed, deepest, unloads, repeats in TESTS:
        if role == "validate":
            continue
        for repeat in range(repeats):
            u = np.linspace(0.2, deepest, 20)
            depth = np.concatenate([u, u[::-1]]) if unloads else u
            branch = np.repeat([0, 1], 20)[: len(depth)]
            for channel, share in (("Fx", 0.02), ("Fz", 1.0)):
                F = share * 0.1 * depth**1.6
                sd = np.sqrt(0.0021**2 + (0.011 * F) ** 2)
                shape = F * (0.06 * np.log10(speed / 0.5) - 0.05 * branch) * gap + 0.004 * rng.standard_normal() * F
                noise = 0.0021 * rng.standard_normal(len(depth))
                residual = {"none": (shape + noise).tolist()}
                if chosen != "none":
                    residual[chosen] = (noise + 0.1 * shape).tolist()
                found.append(
                    {
                        "experiment": name,
                        "channel": channel,
                        "label": str(repeat + 1),
                        "depth": depth.tolist(),
                        "branch": branch.tolist(),
                        "measured": (F + shape + noise).tolist(),
                        "sd": sd.tolist(),
                        "residual": residual,
                    }
                )
    depth = np.repeat([1.0, 2.0, 4.0], 12)
    r = 0.02 * rng.standard_normal(len(depth))
    found.append(
        {
            "experiment": "profile",
            "channel": "uz",
            "label": "",
            "depth": depth.tolist(),
            "branch": [0] * len(depth),
            "measured": (-0.3 * depth + r).tolist(),
            "sd": [0.021] * len(depth),
            "residual": {"none": r.tolist()} | ({chosen: (0.9 * r).tolist()} if chosen != "none" else {}),
        }
    )
    return found


def _signatures(residuals, named, chosen):
    """What the chosen hypothesis takes up of the residuals, and rivals that take up another shape."""
    names = list(dict.fromkeys(n for n in (chosen, *named) if not n.startswith("none")))
    found = []
    for r in residuals if names else ():
        head = {k: v for k, v in r.items() if k not in ("measured", "sd", "residual")}
        base, left = (np.array(r["residual"][n]) for n in ("none", chosen))
        slope = 1 + 0.1 * np.array(r["depth"])
        found.append(head | {"added": {n: ((base - left) * slope**k).tolist() for k, n in enumerate(names)}})
    return found


def _words(verdict, named):
    if verdict == "no_gap":
        return ["No gap beyond noise (p = 0.43, misfit 1.02 times the noise)."]
    cause = {
        "ambiguous": f"Cause: these data cannot separate {', '.join(named)}.",
        "unexplained": "Cause: none in the catalogue reproduces it, or none predicts curves it was not fitted to.",
    }
    return [
        "There is a gap beyond noise (p < 0.005, misfit 2.31 times the noise).",
        "Where, measured against what all other data predict: cycle_100 Fz loading 2.7–4.0 mm (+6.1 ± 0.7 %).",
        cause.get(verdict) or f"Cause: {named[0]} = {SIZE[named[0]][0]:g}; probability 95 %.",
        "On held-out curves (validate curves) the gap is 6.30 before, 4.35 after a re-fit alone, 1.25 with the cause.",
        "This test plan cannot detect, at any plausible size: weight, gain.",
    ]
