"""Layers of flat specimens, from the top down: their table in the settings and their option of `rso new`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import Annotated, Any

from pydantic import BeforeValidator, model_validator

from fem_backend import members
from fem_backend.specimens.own_laws import LAYER_PREFIXES, OwnLaw, OwnMaterial


class Layer(members.MemberTable):
    """{ thickness = 0.3, ratio = 5.0, material = { law = "yeoh" } }: a layer, from the top down."""

    thickness: members.Length
    """Thickness, mm."""
    ratio: Annotated[float, BeforeValidator(members.above(0.0, "the stiffness of the layer over the rest, above 0"))]
    """All moduli of the layer over those of the rest; of a law of its own the initial ones, 1 if it is left out."""
    material: OwnMaterial = None
    """Its own law, of finite strain, whose constants are knobs: layer_mu, layer_D1, layer_C20, …, layer2_mu, …"""

    @model_validator(mode="before")
    @classmethod
    def _stiffness(cls, value: Any) -> Any:
        """A layer with a law of its own may have a modulus of its own, too."""
        given = isinstance(value, Mapping) and value.get("material") is not None
        return {"ratio": 1.0, **value} if given else value


def _listed(value: Any) -> Any:
    """A list of tables, the uppermost ones of which may have a law of their own."""
    if not isinstance(value, list | tuple):
        raise members.refused(": a list of { thickness, ratio } from the top down is expected")
    for k, layer in enumerate(value[len(LAYER_PREFIXES) :], len(LAYER_PREFIXES)):
        if isinstance(layer, Mapping) and layer.get("material") is not None:
            many = len(LAYER_PREFIXES)
            why = f": the first {many} layers from the top may have laws of their own, this is number {k + 1}"
            raise members.refused(why, "material", layer["material"])
    return tuple(value)


def thicknesses_and_ratios(layers: Sequence[Layer]) -> tuple[tuple[float, float], ...]:
    """(thickness mm, ratio) of each."""
    return tuple((layer.thickness, layer.ratio) for layer in layers)


def laws_of(layers: Sequence[Layer]) -> tuple[OwnLaw | None, ...]:
    """The law of each that has its own; nothing where none has."""
    found = tuple(layer.material for layer in layers)
    return found if any(found) else ()


def canonical_layers(layers: Sequence[tuple[float, float]], laws: Sequence[OwnLaw | None]) -> list[dict[str, Any]]:
    """The list of layers as it enters the key of a run."""
    plain = [{"thickness": t, "ratio": k} for t, k in layers]
    return [{**layer, **({"material": own.plain()} if own else {})} for layer, own in zip_longest(plain, laws)]


Layers = Annotated[tuple[Layer, ...], BeforeValidator(_listed)]


def fitting(layers: Sequence[Layer], height: float, words: str) -> None:
    """Refuse layers that are as thick as the specimen."""
    total = sum(layer.thickness for layer in layers)
    if total >= height:
        raise members.refused(
            f": layers of {total:g} mm in all; the rest below them, with ratio 1, must have a thickness: "
            f"{words} = {height:g} mm",
            "layers",
            canonical_layers(thicknesses_and_ratios(layers), laws_of(layers)),
        )


def _of_layers(*pairs: str) -> dict[str, Any]:
    """The settings of layers THICKNESS:RATIO; ValueError for what is none."""
    layers = []
    for pair in pairs:
        try:
            thickness, ratio = map(float, pair.split(":"))
        except ValueError:
            raise ValueError(f"{pair!r}: THICKNESS:RATIO is expected, in mm and a pure number, such as 0.3:5") from None
        layers.append({"thickness": thickness, "ratio": ratio})
    return {"specimen": {"layers": layers}}


LAYERED = members.SettingsOption(
    "layers",
    ("THICKNESS:RATIO",),
    ("text",),
    "layers of a flat specimen from the top: thickness (mm) and stiffness over that of the rest below",
    repeated=True,
    adds=True,
    settings=_of_layers,
)
