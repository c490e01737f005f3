"""The numbers of an experiment that a study may open, with the value that switches each effect off."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from fem_backend.indenters import INDENTERS
from fem_backend.laws import ADDITIONS, LAWS, Elastic
from fem_backend.specimens import SPECIMENS, own_laws
from fem_backend.supports import SUPPORTS
from rso.contract import knob


@dataclass(frozen=True)
class Common:
    """Zones of another stiffness, weight, friction, adhesion and pore flow; lengths in mm, moduli in MPa.

    Defaults and plausible ranges that hold a length are those of the usual specimen and indenter; at another size they
    go in proportion, see `fem_backend.adapter.priors`.  With `pore_D1` and a permeability `D1` is that of the body
    before liquid leaves; without it that of the drained body, whose liquid gives way to no pressure.
    """

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
        "thickness of the skin", "mm", 0.0, 1e6, default=0.5, group="skin", typical=0.5, plausible=(0.25, 2.0)
    )
    delta_layer: float = knob(
        "error of the thickness of the uppermost layer",
        "mm",
        -1e6,
        1e6,
        neutral=0.0,
        typical=0.05,
        plausible=(-0.2, 0.2),
        label="wrong thickness of the layer",
    )
    layer_ratio: float = knob(
        "stiffness of the uppermost layer over what the settings say",
        "1",
        1e-3,
        1e3,
        neutral=1.0,
        typical=1.5,
        plausible=(0.3, 3.0),
        label="wrong stiffness of the layer",
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
    inclusion_radius: float = knob("radius of the inclusion", "mm", 0.0, 1e6, default=5.0, group="inclusion")
    inclusion_x: float = knob(
        "centre of the inclusion, x", "mm", -1e6, 1e6, default=0.0, group="inclusion", plausible=(-16.0, 16.0)
    )
    inclusion_y: float = knob("centre of the inclusion, y", "mm", -1e6, 1e6, default=0.0, group="inclusion")
    inclusion_depth: float = knob(
        "centre of the inclusion below the top of the body",
        "mm",
        0.0,
        1e6,
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
    friction: float = knob(
        "Coulomb friction between indenter and body",
        "1",
        0.0,
        5.0,
        neutral=0.0,
        typical=0.3,
        plausible=(0.03, 1.0),
        label="friction under the indenter",
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
    adhesion_range: float = knob("range of the attraction", "mm", 1e-9, 1e6, default=0.2, group="adhesion")
    pore_D1: float = knob(
        "compressibility that the body gains as liquid leaves its pores",
        "1/MPa",
        0.0,
        1e6,
        neutral=0.0,
        group="pore flow",
        typical=100.0,
        plausible=(0.1, 3.0),
        label="pore flow",
    )
    permeability: float = knob(
        "permeability of the body for the liquid in its pores; 0: no pore flow, the drained solid alone",
        "mm^4/N/s",
        0.0,
        1e12,
        default=0.0,
        group="pore flow",
        plausible=(0.003, 10.0),
        label="pore flow",
    )


@dataclass(frozen=True)
class Pose:
    """How specimen and indenter stand to each other."""

    offset_x: float = knob(
        "misalignment of the indenter in x",
        "mm",
        -1e6,
        1e6,
        neutral=0.0,
        scope="place",
        typical=0.5,
        plausible=(-2.0, 2.0),
        label="misalignment in x",
    )
    offset_y: float = knob(
        "misalignment of the indenter in y",
        "mm",
        -1e6,
        1e6,
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
    """A frozen dataclass of all knobs that its parts declare or share; ValueError where two declare one name."""
    fields: dict[str, tuple[str, Any, dataclasses.Field]] = {}
    for part in parts:
        for f in dataclasses.fields(part):
            known = fields[f.name][2].metadata if f.name in fields else f.metadata
            if known["parameter"] is not f.metadata["parameter"]:  # members may inherit one
                raise ValueError(f"knob {f.name!r} is declared twice")
            default = {} if f.default is dataclasses.MISSING else {"default": f.default}
            fields[f.name] = (f.name, f.type, dataclasses.field(metadata=f.metadata, **default))
    made = dataclasses.make_dataclass(name, fields.values(), frozen=True, namespace={"__module__": __name__})
    made.__doc__ = """Every number that a study may open; an effect also says the value that switches it off.

    Lengths in mm, angles in degrees, moduli in MPa.  `mu` is the initial shear modulus under every law, instantaneous
    where the material relaxes.
    """
    return made


def knobs_class() -> type:
    """The dataclass of all knobs with those of every member that is registered now."""
    return _with(tuple(tuple(s.members.values()) for s in (SPECIMENS, INDENTERS, SUPPORTS, LAWS)))


@functools.lru_cache(maxsize=16)
def _with(members: tuple[tuple[type, ...], ...]) -> type:
    """The same as long as the registered `members` are: it is asked for tens of thousands of times."""
    additions = [addition.Knobs for addition in ADDITIONS]
    body = [*SPECIMENS.knobs(), *own_laws.knobs(), Common, *SUPPORTS.knobs(), *INDENTERS.knobs(), Pose]
    return _known((Elastic, *LAWS.knobs(), *additions, *body))


@functools.cache
def _known(parts: tuple[type, ...]) -> type:
    return composed(parts)


Knobs: Any = knobs_class()


SWITCHES = {  # a group has no influence while one of these knobs has the value beside it
    **{group: switches for addition in ADDITIONS for group, switches in addition.switches.items()},
    "skin": {"skin_ratio": 1.0, "skin_thickness": 0.0},
    "inclusion": {"inclusion_ratio": 1.0, "inclusion_radius": 0.0},
    "adhesion": {"adhesion": 0.0},
    "pore flow": {"permeability": 0.0},
}
