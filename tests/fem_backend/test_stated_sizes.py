"""A radius in another unit fits every curve as well: what a record and its notes say against it."""

import numpy as np
import pytest

from fem_backend.backend import BACKEND
from fem_backend.simulation.experiment import SETS

HALF_SPACE = {"specimen": {"shape": "half_space"}}


def said(indenter, depth, *notes):
    return BACKEND.odd_sizes({**HALF_SPACE, "indenter": indenter}, depth, notes)


@pytest.mark.parametrize("shape", [{"shape": "sphere"}, {"shape": "flat", "fillet": 1e-3}])
def test_a_radius_in_another_unit_is_asked_for(shape):
    """A colloid of 5 µm that is pressed in by 2 µm, as 5 mm; a ball of 5 mm pressed in by 0.6 mm, as 5 µm."""
    for radius, depth, words in ((5.0, 2e-3, "2500 times the deepest reading"), (5e-3, 0.6, "120 times")):
        own = {**shape, "radius": radius} | ({"fillet": 0.1 * radius} if "fillet" in shape else {})
        (text,) = said(own, depth)
        assert words in text and f"indenter.radius = {radius:g} mm" in text and "units" in text
        assert not said({**own, "radius": depth / 0.2} | ({"fillet": 0.5 * depth} if "fillet" in own else {}), depth)


@pytest.mark.parametrize(
    "note",
    [
        "Tip radius (um) 50.000000",
        "Probe diameter [µm]: 100",
        "tip_radius = 0.05 mm",
        "Kugeldurchmesser: 0,1 mm",
        "Tip radius (mm): 0,05",
    ],
)
def test_the_radius_that_a_file_notes_is_compared(note):
    ball = {"shape": "sphere", "radius": 0.05}
    assert said(ball, 0.005, note) == []
    (text,) = said({**ball, "radius": 0.1}, 0.005, note)
    assert note in text and "indenter.radius = 0.1 mm" in text


def test_what_is_no_radius_of_the_indenter_is_left_alone():
    ball = {"shape": "sphere", "radius": 0.05}
    notes = (
        "Tip radius (um)",
        "Tip radius 50",
        "Cell radius (um) 3",
        "k (N/m) 0.5",
        "Tip radius (N) 3",
        "radius: 3 mm",
        "Tip radius (um): 0",  # nobody filled it in
        "Tip radius: 50,000 nm",  # 50 or 50 000
    )
    assert said(ball, 0.005, *notes) == []
    assert said({"shape": "cone", "half_angle": 70.0, "tip_radius": 1e-3}, 0.5, "Tip radius (um) 50") == []


@pytest.mark.parametrize("noun", ["specimen", "indenter"])
def test_a_size_that_nobody_stated_is_said(noun):
    """Of every member that has usual sizes: what is left out is said with its value, what stands is not."""
    found = 0
    for name, member in SETS[noun].members.items():
        table = {"shape": name}
        try:
            built = member.Table.model_validate(table).build()
        except ValueError:  # it has sizes that must be stated
            continue
        usual = {k for k, f in member.Table.model_fields.items() if f.default is not None}
        sizes = {k: v for k, v in built.plain().items() if k in usual and not isinstance(v, bool)}
        sizes = {k: v for k, v in sizes.items() if isinstance(v, float | list | tuple) and np.any(np.asarray(v) > 0)}
        said = [w for w in BACKEND.odd_sizes({noun: table}, 0.5, []) if w.startswith(f"{noun}.")]
        assert {w.split()[0] for w in said} == {f"{noun}.{k}" for k in sizes}
        for k, v in sizes.items():
            (words,) = (w for w in said if w.startswith(f"{noun}.{k} "))
            assert all(f"{x:g}" in words for x in np.atleast_1d(v))
            stated = BACKEND.odd_sizes({noun: {**table, k: v}}, 0.5, [])
            assert not [w for w in stated if w.startswith(f"{noun}.{k} ")]
        found += len(sizes)
    assert found
