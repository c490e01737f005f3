"""What slabs, pucks and half-spaces share: a flat top at z = height, a base at z = 0, layers from the top down."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from skfem import MeshTet2

from fem_backend import members
from fem_backend.meshing import CRUDE_LEVEL, MeridianMesh, Mesh, Size, graded_coordinates, grids, triangulated
from fem_backend.specimens import own_laws
from fem_backend.specimens.own_laws import OwnLaw
from fem_backend.specimens.specimen import LAYER_KNOBS, PLACE_KNOBS, Meshing
from rso.contract import Drawn

# of a meridian: factor on all sizes
MERIDIAN_SIZE_FACTORS = {"coarse": 2.0, "standard": 1.4, "fine": 1.0, "reference": 0.7}
DEPTH_ELEMENT_GROWTH = 0.3  # of the element size per distance from the contact, in depth
FIRST_ELEMENT_RATIO = 1.5  # height of the first elements over the least width
MIN_ELEMENTS_THROUGH_HEIGHT = 5.0  # elements through the height at least, at unit fineness
# elements from the axis to a wall at least, at unit fineness: what is squeezed up beside the contact
MIN_ELEMENTS_TO_WALL = 20.0
FAST_GROWTH_HEIGHTS = 3.0  # heights beside the contact from which elements grow twice as fast
USUAL_LAYER_MM = 0.5  # thickness (mm) that the declared range of its error is meant for
ON_PLANE_TOLERANCE = 1e-9  # of the height: what lies this near a plane lies in it


class FlatTopped:
    """A specimen between z = 0 and z = `height` (mm); a base class, no member.

    `half_width` (mm) is how far the model reaches from the axis, `edge` the radius (mm) of the top's rounded edge, and
    `layers` are (thickness mm, ratio) from the top down, `laws` those that are their own; what is below has the ratio 1
    and the law of the body.  `walled`: it is in a well.
    """

    name: ClassVar[str]
    gauges: ClassVar[Mapping[str, float]] = {}
    makers: ClassVar[Mapping[str, Callable[[Mapping[str, Any]], Mesh]]] = {grids.GRID_MESHER: grids.made_grid}
    parts: ClassVar[tuple[str, ...]] = ("upper", "lower", "base", "side")
    of_revolution: ClassVar[bool] = True
    rests: ClassVar[str] = "bonded"
    alike: ClassVar[bool] = False
    smallest_words: ClassVar[str] = "thickness"
    fattest: ClassVar[float] = math.inf
    grid_edges: str = ""  # of its grid in three dimensions, see `grids.cut`
    height: float
    half_width: float
    cut: ClassVar[float] = math.inf
    """Half widths of a sketch below the top from which on it is cut."""
    edge: float = 0.0
    walled: bool = False
    layers: tuple[tuple[float, float], ...] = ()
    laws: tuple[OwnLaw | None, ...] = ()
    met: tuple[bool, ...] = ()
    """Which interfaces the grid meets, those between unlike layers where nothing is said."""

    @property
    def ratios(self) -> tuple[float, ...]:
        """Stiffness of each layer over the rest, from the top down."""
        return tuple(ratio for _, ratio in self.layers)

    def words_of_layer(self, k: int) -> str:
        """How stiff the layer k from the top is and which law of its own it has."""
        own = self.laws[k] if self.laws else None
        law = f"{own.law.replace('_', ' ')}, " if own else ""
        return f"{law}{self.layers[k][1]:.4g} times as stiff"

    @property
    def smallest(self) -> float:
        """The height or the half width (mm), whichever is less."""
        return min(self.height, self.half_width)

    @property
    def largest(self) -> float:
        """The height or the half width (mm), whichever is more, as far as that matters for an approach from above."""
        return self.height if self.alike else max(self.height, self.half_width)

    @property
    def skin_limit(self) -> float:
        """Half the smallest length (mm)."""
        return 0.5 * self.smallest

    def under(self, indenter: Any) -> FlatTopped:
        """As it is."""
        return self

    @property
    def layers_described(self) -> str:
        """Its layers from the top down, as an addition to what it is."""
        if not self.layers:
            return ""
        each = [f"{members.length_words(t)} ({self.words_of_layer(k)})" for k, (t, _) in enumerate(self.layers)]
        return f" with {'layers' if len(each) > 1 else 'a layer'} of {' and '.join(each)} on top"

    @property
    def described(self) -> str:
        """As its member says."""
        raise NotImplementedError

    def beyond(self, length: float) -> float:
        """Nothing."""
        return 0.0

    def absent(self) -> frozenset[str]:
        """Those of a layer where it has none, of laws that layers do not have, and of a place where all are alike."""
        none = own_laws.absent(self.laws) | frozenset(() if self.layers else LAYER_KNOBS)
        return none | frozenset(PLACE_KNOBS if self.alike else ())

    def within(self, radius: float) -> FlatTopped | None:
        """Itself in a round well of a radius (mm); None where it has no side to be held."""
        return None if self.alike else self

    def planes(self) -> tuple[bool, bool]:
        """Both vertical planes through the axis."""
        return True, True

    def extent(self, way: np.ndarray) -> float:
        """Distance (mm) from the axis to its side along a horizontal unit vector (2,)."""
        return self.half_width

    def drawn(self, way: np.ndarray, wide: float) -> list[Drawn]:
        """A rectangle, whose edge is rounded; its sides are no edges where it goes on beyond them."""
        half, h, low = min(wide, self.extent(way)), self.height, max(0.0, self.height - self.cut * wide)
        f = 0.0 if self.alike else self.edge
        turn = np.linspace(0.0, 0.5 * np.pi, 9)
        corner = np.column_stack([half - f + f * np.cos(turn), h - f + f * np.sin(turn)]) if f else [[half, h]]
        right = [(half, low), *((float(x), float(z)) for x, z in corner)]
        left = [(-x, z) for x, z in right[::-1]]
        out = [Drawn("specimen", tuple(right + left), self.described.removesuffix(self.layers_described))]
        down = h
        for k, (thickness, _) in enumerate(self.layers):
            box = ((-half, down - thickness), (half, down - thickness), (half, down), (-half, down))
            out.append(Drawn("layer", box, f"{members.length_words(thickness)}, {self.words_of_layer(k)}"))
            down -= thickness
        top = tuple(p for p in right + left if p[1] > low)
        out.append(Drawn("edge", (top[0], top[-1]) if self.alike else (*right, *left, right[0])))
        gap = 0.07 * wide
        if low == 0.0:
            side = half + gap
            out.append(Drawn("dimension", ((side, 0.0), (side, h)), members.length_words(h)))
        if not self.alike:
            out.append(Drawn("dimension", ((0.0, 0.25 * h), (half, 0.25 * h)), members.length_words(half)))
        return out

    # ------------------------------------------------------------------------------------------------- surface

    def over_edge(self, x: float, y: float) -> float:
        """How far (mm) a place lies beyond the flat part of the top, negative on it."""
        return -math.inf if self.alike else math.hypot(x, y) - (self.half_width - self.edge)

    def above(self, x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
        """Point and normal of the top; ValueError beside its flat part."""
        if self.over_edge(x, y) > 0.0:
            raise ValueError(f"point {(x, y)} mm is {self.over_edge(x, y):.4g} mm beside the flat top")
        return np.array([x, y, self.height]), np.array([0.0, 0.0, 1.0])

    def part(self, name: str, X: np.ndarray) -> np.ndarray:
        """`upper` is the top with its rounded edge, `lower` and `base` are the base, `side` is the rest."""
        base, top = (
            X[:, 2] <= ON_PLANE_TOLERANCE * self.height,
            X[:, 2] >= self.height * (1.0 - ON_PLANE_TOLERANCE) - self.edge,
        )
        return {"upper": top, "lower": base, "base": base, "side": ~(base | top)}[name]

    def closest(self, x: np.ndarray) -> np.ndarray:
        """Nearest point of the core that the rounding of the edge stands on, moved out by the radius of that."""
        x = np.asarray(x, float)
        core = np.array(x)
        core[2] = min(max(x[2], 0.0), self.height - self.edge)
        if not self.alike:
            r, limit = math.hypot(x[0], x[1]), self.half_width - self.edge
            core[:2] *= min(1.0, limit / max(r, 1e-300))
        away = x - core
        return core + self.edge * away / max(float(np.linalg.norm(away)), 1e-300)

    def distance(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Distance to `closest` and its direction."""
        away = np.asarray(x, float) - self.closest(x)
        d = float(np.linalg.norm(away))
        return d, away if d > 0.0 else np.array([0.0, 0.0, 1.0])

    def depth(self, X: np.ndarray) -> np.ndarray:
        """Distance (…,) to the top or the side; the base is no skin."""
        X = np.asarray(X, float)
        below = self.height - X[..., 2]
        return below if self.alike else np.minimum(below, self.half_width - np.hypot(X[..., 0], X[..., 1]))

    def project(self, x: np.ndarray) -> np.ndarray:
        """Its surface is that of its mesh."""
        return x.copy()

    def on_surface(self, X: np.ndarray) -> np.ndarray:
        """Nodes of the top or the side."""
        return np.abs(self.depth(X)) < ON_PLANE_TOLERANCE * self.height

    def mean_curvature(self, x: float, y: float) -> float:
        """None."""
        return 0.0

    def volume(self) -> float:
        """π w² h."""
        return math.pi * self.half_width**2 * self.height

    @property
    def top(self) -> np.ndarray:
        """(0, 0, h)."""
        return np.array([0.0, 0.0, self.height])

    @property
    def lowest(self) -> np.ndarray:
        """(0, 0, 0)."""
        return np.zeros(3)

    def hole(self, size: float) -> tuple[np.ndarray, np.ndarray]:
        """A hollow half ball in the middle of the base, a third as high as the specimen."""
        return self.lowest, np.full(3, size * self.smallest / 3.0)

    # ------------------------------------------------------------------------------------------------- what is modelled

    def refusal(self, indenter: Any, point: tuple[float, float]) -> list[str]:
        """A place beside the top."""
        if self.over_edge(*point) <= 0.0:
            return []
        return [f"point = {list(point)} mm: {self.over_edge(*point):.4g} mm beside the flat top"]

    def beside(self, x: float, y: float) -> str | None:
        """A mark lies on the top."""
        if self.over_edge(x, y) <= 0.0:
            return None
        return f"profile: the mark ({x:g}, {y:g}) mm lies {self.over_edge(x, y):.4g} mm beside the flat top"

    def thickness_along(self, direction: np.ndarray) -> float:
        """The height (mm): its top is touched from above."""
        return self.height

    def off_top(self, x: float, y: float) -> float:
        """All places of the top are alike for elements."""
        return 0.0

    # ------------------------------------------------------------------------------------------------- mesh

    def meshing(self, length: float, mesher: str, level: str, n: int, slip: float) -> Meshing:
        """A level of the meridian and of the grid in three dimensions; other meshers and levels are refused."""
        if mesher != "tetwild":
            raise ValueError(f"mesh.mesher = {mesher!r}: a {self.name} has its own meshes; leave the key out")
        if level not in (*MERIDIAN_SIZE_FACTORS, CRUDE_LEVEL):
            raise ValueError(
                f"mesh.level = {level!r}: not for a {self.name}; choose from {', '.join(MERIDIAN_SIZE_FACTORS)}"
            )
        recipe = grids.grid_recipe(*self.grid_planes(), length, level, self.grid_edges)
        return Meshing(
            recipe, (("level", level),), grids.first_size(length, level), level, MERIDIAN_SIZE_FACTORS.get(level, 1.0)
        )

    def quadratic(self, mesh: Mesh, recipe: str, point: tuple[float, float], planes: tuple[bool, bool]) -> MeshTet2:
        """The grid of a recipe as a box, its finest elements at the point; raises BadMesh."""
        return grids.on_grid(mesh, recipe, self.grid_planes(), point, planes)

    def grid_planes(self) -> tuple[list[float], list[float], list[float]]:
        """Planes x, y and z (mm) that the grid in three dimensions must hit, from the axis and the base on."""
        return self.rings(), self.rings(), self.interfaces()

    def interfaces(self) -> list[float]:
        """Heights (mm) that the grid must hit, from the base to the top."""
        return self.planes_of_layers()

    def planes_of_layers(self) -> list[float]:
        """Heights (mm) of base, interfaces that the grid meets and top, from below."""
        down = np.cumsum([t for t, _ in self.layers])
        seen = [float(d) for d, here in zip(down, self.met or self.unlike, strict=True) if here]
        return [0.0, *(self.height - d for d in seen[::-1]), self.height]

    @property
    def unlike(self) -> tuple[bool, ...]:
        """Whether each layer differs from what is below it."""
        ratios, laws = [*self.ratios, 1.0], [*(self.laws or (None,) * len(self.layers)), None]
        below = zip(ratios[1:], laws[1:], strict=True)
        return tuple(k != r or bool(v or w) for k, v, (r, w) in zip(ratios, laws, below, strict=False))

    def meridian(self, actual: FlatTopped, spacing: Size, fineness: float, samples: int | None = None) -> MeridianMesh:
        """A graded grid of its own sizes, moved to those of `actual` layer by layer."""
        widest = self.half_width / MIN_ELEMENTS_TO_WALL if self.walled else math.inf
        near = FIRST_ELEMENT_RATIO * float(spacing(np.linspace(0.0, self.half_width, 2001)).min())
        reach = FAST_GROWTH_HEIGHTS * self.height

        def across(r: np.ndarray) -> np.ndarray:
            return fineness * np.minimum(spacing(r) + DEPTH_ELEMENT_GROWTH * np.maximum(r - reach, 0.0), widest)

        def down(z: np.ndarray) -> np.ndarray:
            return fineness * np.minimum(
                near + DEPTH_ELEMENT_GROWTH * (self.height - z), self.height / MIN_ELEMENTS_THROUGH_HEIGHT
            )

        met = tuple(a or b for a, b in zip(self.unlike, actual.unlike, strict=True))
        both: list[Any] = [self, actual]
        both = [replace(body, met=met) for body in both] if met else both
        own, other = (body.interfaces() for body in both)
        r, z = graded_coordinates(across, tuple(self.rings()), samples), graded_coordinates(down, tuple(own), samples)

        def moved(points: np.ndarray) -> np.ndarray:
            wide = np.interp(points[:, 0], self.rings(), actual.rings())
            return actual.rounded(np.column_stack([wide, np.interp(points[:, 1], own, other)]))

        return triangulated(r, z, moved)

    def rings(self) -> list[float]:
        """Radii (mm) that the grid must hit, from the axis to the side."""
        return [0.0, self.half_width]

    def rounded(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 2) of the grid of a sharp-edged body, moved into the rounded one."""
        return points

    def stiffness(self, X: np.ndarray) -> np.ndarray | None:
        """The ratio of the layer that a point lies in, 1 where that is in a law of its own."""
        laws = self.laws or (None,) * len(self.layers)
        ratios = np.array([*(1.0 if own else k for k, own in zip(self.ratios, laws, strict=True)), 1.0])
        return None if (ratios == 1.0).all() else ratios[self.layer(X) - 1]

    def layer(self, X: np.ndarray) -> np.ndarray:
        """Number (…) of the layer that points X (…, 3) lie in: 1, 2, … from the top, 0 is the rest."""
        k = np.searchsorted(np.cumsum([t for t, _ in self.layers]), self.height - X[..., 2])
        return (k + 1) % (len(self.layers) + 1)

    def uppermost(self) -> dict[str, float]:
        """Of `dimensions`: thickness and stiffness of the uppermost layer."""
        return {"delta_layer": self.layers[0][0], "layer_ratio": 1.0} if self.layers else {}

    def upper(self) -> dict[str, float]:
        """Of `factors`: the error of a layer goes with its thickness, or that of what is below where that is less."""
        if not self.layers:
            return {}
        t = self.layers[0][0]
        return {"delta_layer": min(t, self.height - sum(v for v, _ in self.layers)) / USUAL_LAYER_MM}

    def changed(self, knobs: Any, k: float) -> tuple[tuple[float, float], ...]:
        """Layers of a specimen `k` times as high, the uppermost with its own errors; ValueError where one vanishes."""
        layers = [(k * t, ratio) for t, ratio in self.layers]
        if not layers:
            return ()
        t, ratio = layers[0]
        left = self.height - sum(v for v, _ in self.layers)
        if not 0.0 < t + knobs.delta_layer < t + k * left:
            raise ValueError(
                f"delta_layer = {knobs.delta_layer:g} mm: the uppermost layer, {t:g} mm thick, would leave nothing of "
                "itself or of what is below"
            )
        return ((t + knobs.delta_layer, ratio * knobs.layer_ratio), *layers[1:])

    # ------------------------------------------------------------------------------------------------- proposals

    def places(self) -> tuple[tuple[float, float], ...]:
        """No other ones."""
        return ()

    def lines(self, point: tuple[float, float], beside: float, unit: float) -> dict[str, list[list[float]]]:
        """Thirteen marks on a line through the axis of the test, over six heights or the width."""
        reach = min(3.0 * self.height, 0.9 * (self.half_width - self.edge) - math.hypot(*point))
        if reach <= beside:
            return {}
        x = np.linspace(-1.0, 1.0, 13) * reach
        row = [[float(f"{unit * round(float(point[0] + v) / unit, 2):.12g}"), point[1] + beside] for v in x]
        return {"surface marks along x": [m for m in row if self.beside(m[0], m[1]) is None]}
