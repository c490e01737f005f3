"""The numbers of an experiment that a study may open, with the value that switches each effect off."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from fem_backend.supports import SUPPORTS
from rso.contract import knob


@dataclass(frozen=True)
class Common:
    """Numbers of every experiment.

    Lengths in mm, angles in degrees, moduli in MPa.  `mu` is the initial shear modulus under every law, instantaneous
    where the material relaxes.  Defaults and plausible ranges that hold a length are those of the usual specimen and
    ball; at another size they go in proportion, see `fem_backend.adapter.priors`.
    """

    mu: float = knob("initial shear modulus", "MPa", 1e-6, 1e3)
    D1: float = knob("compressibility, bulk modulus K = 2/D1", "1/MPa", 1e-6, 1e6)
    # material
    C01: float = knob("Mooney-Rivlin C01 (C10 = mu/2 - C01)", "MPa", -1e3, 1e3, neutral=0.0, typical=1e-3)
    C20: float = knob(
        "Yeoh C20, strain stiffening",
        "MPa",
        -1e3,
        1e3,
        neutral=0.0,
        group="yeoh",
        typical=4e-4,
        plausible=(0.01, 0.4),
        cause="strain stiffening",
        label="stiffening (Yeoh)",
    )
    C30: float = knob(
        "Yeoh C30, strain stiffening", "MPa", -1e3, 1e3, neutral=0.0, group="yeoh", typical=5e-5, plausible=(0.0, 0.04)
    )
    alpha: float = knob("Ogden exponent (one term)", "1", -30.0, 30.0, neutral=2.0, typical=5.0, plausible=(0.8, 12.0),
                        cause="strain stiffening", label="stiffening (Ogden)")  # fmt: skip
    prony_g: float = knob(
        "relaxing share of the shear modulus, first term",
        "1",
        0.0,
        0.95,
        neutral=0.0,
        group="prony",
        typical=0.2,
        plausible=(0.03, 0.6),
        label="relaxation",
    )
    prony_tau: float = knob(
        "relaxation time, first term", "s", 1e-9, 1e9, default=5.0, group="prony", typical=5.0, plausible=(0.3, 100.0)
    )
    prony_g2: float = knob("relaxing share of the shear modulus, second term", "1", 0.0, 0.95, neutral=0.0,
                           group="prony2", typical=0.1)  # fmt: skip
    prony_tau2: float = knob("relaxation time, second term", "s", 1e-9, 1e9, default=50.0, group="prony2")
    prony_g3: float = knob("relaxing share of the shear modulus, third term", "1", 0.0, 0.95, neutral=0.0,
                           group="prony3", typical=0.1)  # fmt: skip
    prony_tau3: float = knob("relaxation time, third term", "s", 1e-9, 1e9, default=0.5, group="prony3")
    mullins: float = knob(
        "largest Mullins softening, 1/r of Ogden-Roxburgh",
        "1",
        0.0,
        0.95,
        neutral=0.0,
        group="mullins",
        typical=0.2,
        plausible=(0.03, 0.6),
        label="Mullins softening",
    )
    mullins_m: float = knob(
        "energy scale m of the softening over mu", "1", 1e-4, 1e3, default=0.1, group="mullins", plausible=(0.02, 0.5)
    )
    mullins_beta: float = knob("energy slope beta of the softening", "1", 0.0, 10.0, default=0.5, group="mullins")
    fibre: float = knob(
        "fibre modulus k1",
        "MPa",
        0.0,
        1e3,
        neutral=0.0,
        group="fibre",
        typical=5e-3,
        plausible=(0.05, 3.0),
        label="fibres",
    )
    fibre_k2: float = knob("fibre stiffening exponent k2", "1", 0.0, 100.0, default=0.0, group="fibre")
    fibre_angle: float = knob(
        "fibre direction in the plane z = 0, from x",
        "deg",
        -180.0,
        180.0,
        default=0.0,
        group="fibre",
        plausible=(0.0, 90.0),
    )
    # body
    delta_a: float = knob(
        "error of the major semi-axis (x)",
        "mm",
        -1e3,
        1e3,
        neutral=0.0,
        typical=1.0,
        plausible=(-4.0, 4.0),
        label="wrong semi-axis a",
    )
    delta_b: float = knob(
        "error of the minor semi-axis (y)",
        "mm",
        -1e3,
        1e3,
        neutral=0.0,
        typical=1.0,
        plausible=(-3.0, 3.0),
        label="wrong semi-axis b",
    )
    delta_c: float = knob(
        "error of the vertical semi-axis (z)",
        "mm",
        -1e3,
        1e3,
        neutral=0.0,
        typical=1.0,
        plausible=(-3.0, 3.0),
        label="wrong semi-axis c",
    )
    skin_ratio: float = knob(
        "stiffness of the skin over that of the core",
        "1",
        1e-3,
        1e3,
        neutral=1.0,
        group="skin",
        typical=2.0,
        plausible=(0.2, 5.0),
        label="skin",
    )
    skin_thickness: float = knob(
        "thickness of the skin", "mm", 0.0, 1e3, default=0.5, group="skin", typical=0.5, plausible=(0.25, 2.0)
    )
    inclusion_ratio: float = knob(
        "stiffness of the inclusion over that of the body",
        "1",
        1e-3,
        1e3,
        neutral=1.0,
        group="inclusion",
        typical=5.0,
        plausible=(0.1, 20.0),
        label="inclusion",
    )
    inclusion_radius: float = knob("radius of the inclusion", "mm", 0.0, 1e3, default=5.0, group="inclusion")
    inclusion_x: float = knob(
        "centre of the inclusion, x", "mm", -1e3, 1e3, default=0.0, group="inclusion", plausible=(-16.0, 16.0)
    )
    inclusion_y: float = knob("centre of the inclusion, y", "mm", -1e3, 1e3, default=0.0, group="inclusion")
    inclusion_depth: float = knob(
        "centre of the inclusion below the top of the body",
        "mm",
        0.0,
        1e3,
        default=15.0,
        group="inclusion",
        plausible=(7.4, 30.0),
    )
    cavity: float = knob(
        "size of the cavity below over that of the settings",
        "1",
        0.0,
        10.0,
        neutral=0.0,
        typical=1.0,
        plausible=(0.3, 1.5),
        label="cavity",
    )
    weight: float = knob(
        "specific weight, density times g",
        "N/mm^3",
        0.0,
        1e-2,
        neutral=0.0,
        typical=1e-5,
        plausible=(1e-4, 4e-3),
        label="weight",
    )
    # contact and boundary
    friction: float = knob(
        "Coulomb friction between indenter and body",
        "1",
        0.0,
        5.0,
        neutral=0.0,
        typical=0.3,
        plausible=(0.03, 1.0),
        label="friction under the ball",
    )
    adhesion: float = knob(
        "work of adhesion",
        "N/mm",
        0.0,
        1e3,
        neutral=0.0,
        group="adhesion",
        typical=1e-4,
        plausible=(1e-3, 0.2),
        label="adhesion",
    )
    adhesion_range: float = knob("range of the attraction", "mm", 1e-9, 1e3, default=0.2, group="adhesion")


@dataclass(frozen=True)
class Pose:
    """How specimen and indenter stand to each other."""

    delta_R: float = knob(
        "error of the indenter radius",
        "mm",
        -100.0,
        100.0,
        neutral=0.0,
        typical=0.05,
        plausible=(-0.3, 0.3),
        label="wrong ball radius",
    )
    offset_x: float = knob(
        "misalignment of the indenter in x",
        "mm",
        -100.0,
        100.0,
        neutral=0.0,
        scope="place",
        typical=0.5,
        plausible=(-2.0, 2.0),
        label="misalignment in x",
    )
    offset_y: float = knob(
        "misalignment of the indenter in y",
        "mm",
        -100.0,
        100.0,
        neutral=0.0,
        scope="place",
        typical=0.5,
        plausible=(-2.0, 2.0),
        label="misalignment in y",
    )
    tilt_x: float = knob(
        "specimen turned about x",
        "deg",
        -20.0,
        20.0,
        neutral=0.0,
        scope="mounting",
        typical=2.0,
        plausible=(-6.0, 6.0),
        label="tilt about x",
    )
    tilt_y: float = knob(
        "specimen turned about y",
        "deg",
        -20.0,
        20.0,
        neutral=0.0,
        scope="mounting",
        typical=2.0,
        plausible=(-6.0, 6.0),
        label="tilt about y",
    )


def composed(parts: Iterable[type], name: str = "Knobs") -> type:
    """A frozen dataclass of all knobs that its parts declare, in their order; ValueError where two have one name."""
    fields: dict[str, tuple[str, Any, dataclasses.Field]] = {}
    for part in parts:
        for f in dataclasses.fields(part):
            if f.name in fields:
                raise ValueError(f"knob {f.name!r} is declared twice")
            default = {} if f.default is dataclasses.MISSING else {"default": f.default}
            fields[f.name] = (f.name, f.type, dataclasses.field(metadata=f.metadata, **default))
    made = dataclasses.make_dataclass(name, fields.values(), frozen=True, namespace={"__module__": __name__})
    made.__doc__ = "Every number that a study may open; an effect also says the value that switches it off."
    return made


def known() -> type:
    """The dataclass of all knobs with those of every member that is registered now."""
    return _known(tuple([Common, *SUPPORTS.knobs(), Pose]))


@functools.cache
def _known(parts: tuple[type, ...]) -> type:
    return composed(parts)


Knobs: Any = known()


SWITCHES = {  # a group has no influence while one of these knobs has the value beside it
    "prony": {"prony_g": 0.0}, "prony2": {"prony_g2": 0.0}, "prony3": {"prony_g3": 0.0}, "mullins": {"mullins": 0.0},
    "fibre": {"fibre": 0.0}, "skin": {"skin_ratio": 1.0, "skin_thickness": 0.0},
    "inclusion": {"inclusion_ratio": 1.0, "inclusion_radius": 0.0}, "adhesion": {"adhesion": 0.0},
}  # fmt: skip
