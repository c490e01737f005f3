"""A depth that counts from a preload: contact before it, by shapes that the reader does not assume exactly."""

import numpy as np
import pytest

from rso.data import preload
from rso.data.files.reading import read_measurement

PRELOAD, DEEPEST = 0.01, 1.5  # N, mm


def force(u, stiffens=0.1):
    """A ball on a layer: no power of the reader's families, N at mm."""
    u = np.maximum(u, 0.0)
    return 0.08 * u**1.5 * np.exp(stiffens * u)


def contact_of(stiffens=0.1):
    """Depth (mm) at which the force is the preload."""
    u = np.linspace(0.0, 1.0, 200_001)
    return float(np.interp(PRELOAD, force(u, stiffens), u))


def written(path, first=0.0, taken=0.0, noise=1e-4, stiffens=0.1, count=60, seed=1):
    """A record whose depth counts from the preload, of which `taken` N was tared off."""
    depth = np.linspace(first, DEEPEST, count)
    random = np.random.default_rng(seed)
    F = force(depth + contact_of(stiffens), stiffens) - taken + noise * random.standard_normal(count)
    rows = [f"{d:.5f},{f:.7f}" for d, f in zip(depth, F, strict=True)]
    path.write_text("\n".join(["depth_mm,Fz_N", *rows]) + "\n")
    return path


@pytest.mark.parametrize("taken", [0.0, PRELOAD])
@pytest.mark.parametrize("stiffens", [-0.1, 0.0, 0.3])
def test_contact_is_found_before_the_preload(tmp_path, taken, stiffens):
    m = read_measurement(written(tmp_path / "a.csv", taken=taken, stiffens=stiffens), {}, PRELOAD)
    found = m.repeats[0].depth[0]
    assert abs(found - contact_of(stiffens)) < 3.0 * m.contact < 0.15 * DEEPEST
    assert m.repeats[0].channels["Fz"][0] == pytest.approx(PRELOAD, abs=5e-4)
    assert ("added to Fz" in m.doubts[0]) == bool(taken)


def test_deviation_covers_the_error():
    """Of 40 records two in three are within the deviation, and none beyond four."""
    depth = np.linspace(0.0, DEEPEST, 60)
    z = []
    for seed in range(40):
        F = force(depth + contact_of()) + 2e-4 * np.random.default_rng(seed).standard_normal(60)
        found = preload.contact(depth, F, PRELOAD)
        z.append((found.depth + contact_of()) / found.deviation)
    assert np.mean(np.abs(z) < 1.0) > 0.6 and np.max(np.abs(z)) < 4.0


def test_an_approach_tells_it_where_the_record_has_one(tmp_path):
    m = read_measurement(written(tmp_path / "a.csv", first=-0.8, count=100), {}, PRELOAD)
    assert "by its approach" in m.doubts[0]
    depth, F = m.repeats[0].depth, m.repeats[0].channels["Fz"]
    assert abs(np.interp(PRELOAD, F[depth > 0], depth[depth > 0]) - contact_of()) < 4.0 * m.contact


def test_a_force_that_is_neither_is_refused(tmp_path):
    with pytest.raises(ValueError, match="neither that nor 0"):
        read_measurement(written(tmp_path / "a.csv"), {}, 2.0 * PRELOAD)
