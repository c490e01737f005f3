"""The welded beam of Ragsdell and Phillips (1976), in the form of Coello (2000), as a model of lengths in mm."""

import math

import rso

INCH, PSI, POUND = 25.4, 0.00689475729, 4.4482216
LOAD, SPAN = 6000.0, 14.0  # lb, inch
E, G = 30e6, 12e6  # psi


@rso.model(
    parameters={
        "weld_height": (1.0, 200.0, "mm"),
        "weld_length": (1.0, 500.0, "mm"),
        "beam_height": (1.0, 500.0, "mm"),
        "beam_width": (1.0, 200.0, "mm"),
    },
    channels={"cost": "1", "deflection": "mm", "shear_stress": "MPa", "bending_stress": "MPa", "buckling_load": "N"},
)
def beam(weld_height, weld_length, beam_height, beam_width):
    """Cost (dollars), deflection of the end, stresses of weld and beam, and the load at which the beam buckles."""
    h, l, t, b = (v / INCH for v in (weld_height, weld_length, beam_height, beam_width))
    direct = LOAD / (math.sqrt(2) * h * l)
    arm = math.sqrt(l**2 / 4 + ((h + t) / 2) ** 2)
    moment = LOAD * (SPAN + l / 2)
    polar = 2 * math.sqrt(2) * h * l * (l**2 / 12 + ((h + t) / 2) ** 2)
    turning = moment * arm / polar
    shear = math.sqrt(direct**2 + 2 * direct * turning * l / (2 * arm) + turning**2)
    buckling = 4.013 * E * t * b**3 / (6 * SPAN**2) * (1 - t / (2 * SPAN) * math.sqrt(E / (4 * G)))
    return {
        "cost": 1.10471 * h**2 * l + 0.04811 * t * b * (SPAN + l),
        "deflection": 4 * LOAD * SPAN**3 / (E * t**3 * b) * INCH,
        "shear_stress": shear * PSI,
        "bending_stress": 6 * LOAD * SPAN / (b * t**2) * PSI,
        "buckling_load": buckling * POUND,
    }
