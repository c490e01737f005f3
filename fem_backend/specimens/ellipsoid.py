"""A solid ellipsoid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np

from fem_backend import members
from fem_backend.specimens.ellipsoidal import Ellipsoidal
from fem_backend.specimens.in_space import HALF_SIZE_TO_CAVITY
from fem_backend.specimens.specimen import MIN_SIZE_RATIO, SPECIMENS
from rso.contract import knob

USUAL_SEMI_AXES_MM = (60.0, 35.0, 35.0)  # semi-axes (mm) that declared ranges of knobs are meant for


@SPECIMENS.register
@dataclass(frozen=True)
class Ellipsoid(Ellipsoidal):
    """Of the semi-axes a, b, c along x, y and z, its origin at the centre."""

    class Table(members.MemberTable):
        """{ shape = "ellipsoid", semi_axes = [60, 35, 35], cavity = semi-axes of a cavity below, knob cavity }"""

        shape: Literal["ellipsoid"] = "ellipsoid"
        """A solid ellipsoid, its origin at the centre."""
        semi_axes: members.Three = USUAL_SEMI_AXES_MM
        """Semi-axes along x, y and z, mm."""
        cavity: members.Three | None = None
        """Semi-axes of a cavity around the lowest point, mm: the knob `cavity` is its size over these."""

        def build(self) -> Ellipsoid:
            """The specimen of these settings."""
            hollow = tuple(v / k for v, k in zip(self.semi_axes, HALF_SIZE_TO_CAVITY, strict=True))
            return Ellipsoid(*self.semi_axes, hollow if self.cavity is None else self.cavity)

    @dataclass(frozen=True)
    class Knobs:
        """Errors of the semi-axes."""

        delta_a: float = knob(
            "error of the major semi-axis (x)",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=1.0,
            plausible=(-4.0, 4.0),
            label="wrong semi-axis a",
        )
        delta_b: float = knob(
            "error of the minor semi-axis (y)",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=1.0,
            plausible=(-3.0, 3.0),
            label="wrong semi-axis b",
        )
        delta_c: float = knob(
            "error of the vertical semi-axis (z)",
            "mm",
            -1e6,
            1e6,
            neutral=0.0,
            typical=1.0,
            plausible=(-3.0, 3.0),
            label="wrong semi-axis c",
        )

    name: ClassVar[str] = "ellipsoid"
    gauges: ClassVar[Mapping[str, float]] = {"delta_a": 0.1, "delta_b": 0.1, "delta_c": 0.1}
    options: ClassVar[tuple[members.SettingsOption, ...]] = tuple(
        members.SettingsOption(
            name,
            ("A", "B", "C"),
            ("mm", "mm", "mm"),
            f"an ellipsoid: semi-axes along x, y and upwards{also}",
            settings=lambda a, b, c: {"specimen": {"shape": "ellipsoid", "semi_axes": [a, b, c]}},
        )
        for name, also in (("ellipsoid", ""), ("semi-axes", ", the older name of --ellipsoid"))
    )

    def plain(self) -> dict[str, Any]:
        """The table of the canonical settings."""
        return {"shape": self.name, "semi_axes": self.semi_axes.tolist(), "cavity": list(self.cavity)}

    def actual(self, knobs: Any) -> Ellipsoid:
        """The body with the errors of its semi-axes; ValueError for sizes that describe none."""
        axes = self.semi_axes + np.array([knobs.delta_a, knobs.delta_b, knobs.delta_c])
        least = MIN_SIZE_RATIO * self.semi_axes.min()
        if axes.min() <= least:
            errors = ", ".join(f"{n} = {getattr(knobs, n):g}" for n in ("delta_a", "delta_b", "delta_c"))
            raise ValueError(
                f"{errors} mm: semi-axes {axes.tolist()} mm, all must be larger than {least:g} mm "
                f"({MIN_SIZE_RATIO:g} of the smallest asked for)"
            )
        return replace(self, a=axes[0], b=axes[1], c=axes[2])

    def dimensions(self) -> Mapping[str, float]:
        """Its semi-axes."""
        return dict(zip(("delta_a", "delta_b", "delta_c"), map(float, self.semi_axes), strict=True))

    def factors(self) -> Mapping[str, float]:
        """Each error goes with its semi-axis."""
        return dict(zip(("delta_a", "delta_b", "delta_c"), map(float, self._relative), strict=True))

    @property
    def _relative(self) -> np.ndarray:
        return self.semi_axes / np.array(USUAL_SEMI_AXES_MM)

    @property
    def ratio(self) -> float:
        """Cube root of the volume over that of the usual one."""
        a, b, c = (float(v) for v in self._relative)
        return (a * b * c) ** (1.0 / 3.0)
