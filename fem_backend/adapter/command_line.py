"""What the command line of `rso` asks of this backend, as plain data: read at every start, so nothing is imported."""

LABORATORY = {  # what a nominal.json of `rso blind` may say, and as which settings
    "parts": {
        "specimen": {
            "sizes": {"semi_axes_mm": ("semi_axes", 3)},
            "granted": {"shape": ["ellipsoid"]},
            "setting": {"shape": "ellipsoid"},
        },
        "indenter": {
            "sizes": {"radius_mm": ("radius", 1)},
            "granted": {
                "shape": ["sphere"],
                "rigid": [True],
                "full_sphere": [True],
                "direction": [[0, 0, -1]],
                "friction": [0],
            },
            "setting": {"shape": "sphere"},
        },
    },
    "supports": {
        "fixed": {"words": ("fixed", "held", "bonded", "glued", "clamped"), "numbers": {}},
        "bowl": {
            "words": ("bowl", "platform"),
            "numbers": {"clearance_mm": ("clearance", 1.0), "friction": ("friction", 0.2)},
        },
    },
    "assumed": ("fixed", "the lower half held"),
    "without_numbers": "the specimen is held",
    "beside": {"clearance_mm": "clearance_mm", "mu_platform": "friction"},
    "parameters": {  # their product, the axis of the library: ν from 0.125 to 0.499
        "mu": {"low": "5 kPa", "high": "20 kPa", "scale": "log"},
        "D1": {"low": "1 1/MPa", "high": "100 1/MPa", "scale": "log"},
    },
    "example": """\
  "specimen": {"shape": "ellipsoid", "semi_axes_mm": [60, 35, 35]},
  "indenter": {"shape": "sphere", "radius_mm": 3},
  "support": "fixed: lower half bonded to the holder",""",
    "ranges": "mu is taken to be 5 to 20 kPa\nand D1 1 to 100 1/MPa",
}
