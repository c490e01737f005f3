"""`deformed.json`, the body of the best candidate as it is deformed, made by one simulation more."""

from __future__ import annotations

from rso.result_types.keys import ByName, ResultBlock, holds

FieldValues = dict[str, tuple[float, ...]]


class FrameBlock(ResultBlock):
    """A vertical section at one travel."""

    travel: float = holds("of the indenter", "mm")
    force: float = holds("on it", "N")
    points: tuple[tuple[float, float], ...] = holds("across and up", "mm")
    triangles: tuple[tuple[int, int, int], ...] | None = holds("of the points; null where they are as before")
    fields: FieldValues = holds("field → its value at each point")
    indenter: tuple[tuple[float, float], ...] = holds("its outline", "mm")
    mirrored: bool = holds("whether the section goes on beyond 0 as its mirror image")


class SurfaceInSpaceBlock(ResultBlock):
    """The surface of the body at the deepest travel."""

    points: tuple[tuple[float, float, float], ...] = holds("x, y, z", "mm")
    triangles: tuple[tuple[int, int, int], ...] = holds("of the points")
    fields: FieldValues = holds("field → its value at each point")
    mirrored: tuple[bool, bool] = holds("whether it goes on beyond x = 0 and y = 0 as its mirror image")


class DeformedFile(ResultBlock):
    """The body of the best candidate as it is deformed, which the report draws."""

    key: str = holds("key of the simulation in the store")
    experiment: str = holds("the experiment that is drawn")
    values: ByName = holds("parameters")
    plane: str = holds("the plane of the sections")
    units: dict[str, str] = holds("field → unit, the most telling first")
    frames: tuple[FrameBlock, ...] = holds("sections from contact to the end")
    surface: SurfaceInSpaceBlock | None = holds("the surface in space")
