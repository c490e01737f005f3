"""What the command line of `rso` asks of this backend, as plain data: read at every start, so nothing is imported."""

OPTIONS = (  # of `rso new`: as many numbers as there are words in metavar
    {"name": "semi-axes", "metavar": ("A", "B", "C"), "required": True,
     "help": "of the ellipsoid along x, y and upwards, mm"},
    {"name": "radius", "metavar": ("R",), "required": True, "help": "of the ball, mm"},
    {"name": "bowl", "metavar": ("CLEARANCE",), "required": False,
     "help": "it lies in a bowl so much (mm) larger in each semi-axis (default: its lower half is held)"},
)  # fmt: skip
