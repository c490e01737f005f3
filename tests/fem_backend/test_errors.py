"""What holds for stated errors whatever their calibration; whether they cover is in tests/verification."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fem_backend import errors, experiment
from fem_backend.backend import BACKEND
from fem_backend.indentation import Result, profile_name
from fem_backend.meshing import LEVELS
from fem_backend.newton import Counters

VALUES = {"mu": 0.01, "D1": 5.8}
PROFILE = [[0.5, 0.0], [6.0, 2.0]]


def result(force=(0.0, 0.0, 1.0), lengths=1.0, forces=1.0):
    """Three points such as a run to 2 mm gives; every length and force may be multiplied."""
    travel, size = np.array([0.5, 1.0, 2.0]), np.array([0.03, 0.085, 0.229])
    radius = np.array([1.1, 1.6, 2.2])
    channels = {
        "time": travel, "travel": lengths * travel,
        **{n: forces * f * size for n, f in zip(errors.FORCES, force, strict=True)},
        "uz_max": lengths * 1.001 * travel, "bulge": lengths * 0.004 * travel,
        "contact_area": lengths**2 * 3.5 * radius**2, "contact_radius": lengths * radius,
        "peak_pressure": forces / lengths**2 * np.array([0.010, 0.014, 0.018]), "slipping": np.array([0.2, 0.1, 0.1]),
        **{profile_name((lengths * x, lengths * y)): -lengths * u * travel
           for (x, y), u in zip(PROFILE, (0.95, 0.1), strict=True)},
    }  # fmt: skip
    return Result(channels, np.zeros((3, 3)), forces * 0.005 * size, np.zeros(3), Counters(), 0.0)


def settings(level="coarse", scale=1.0, **more):
    specimen = {"semi_axes": [60.0 * scale, 35.0 * scale, 35.0 * scale]}
    table = {"specimen": specimen, "indenter": {"radius": 3.0 * scale}, "mesh": {"level": level}}
    return experiment.read_settings({**table, "profile": [[scale * x, scale * y] for x, y in PROFILE], **more})


def knobs(**values):
    return BACKEND.knobs({**VALUES, **values}, settings())


def stated(found=None, at=None, **values):
    return errors.stated(at or settings(), knobs(**values), found or result())


def test_every_channel_of_a_run_has_an_error(make_bench):
    bench = make_bench({"friction": 0.2}, profile=PROFILE)
    found = bench.solve([0.5, 1.0])
    error = errors.stated(bench.settings, bench.knobs, found)
    assert set(error) == set(found.channels)
    for name, values in error.items():
        assert values.shape == (2,) and np.isfinite(values).all() and (values >= 0).all(), name
        assert (values > 0).all() == (name not in ("time", "travel", "Fx", "Fy")), name


def test_forces_that_vanish_by_symmetry_are_exact_and_others_are_not():
    assert not np.any([stated()[n] for n in ("Fx", "Fy")])
    aside = stated(result((0.02, 0.0, 1.0)))
    assert (aside["Fx"] > 0).all() and not aside["Fy"].any()
    # a small lateral force is the difference of large ones: its relative error is larger
    assert (aside["Fx"] / 0.02 > aside["Fz"]).all()


def test_nothing_slips_without_friction():
    assert not stated()["slipping"].any() and stated(friction=0.3)["slipping"].all()


def test_longer_steps_are_rougher_for_friction():
    usual = settings()
    long = replace(usual, control=replace(usual.control, path=2 * usual.control.path))
    for name in ("Fz", "slipping"):
        assert (stated(at=long, friction=0.3)[name] > stated(at=usual, friction=0.3)[name])[1:].all()
        assert (stated(at=long)[name] == stated(at=usual)[name]).all()


def test_finer_levels_state_less():
    found = [stated(at=settings(level), friction=0.3) for level in LEVELS]
    for coarse, fine in pairwise(found):
        for name in set(coarse) - {"time", "travel", "Fx", "Fy", "slipping"}:
            assert (fine[name] < coarse[name]).all(), name


def test_extrapolated_forces_state_less_and_nothing_else_does():
    plain, limit = stated(at=settings("reference")), stated(at=settings("limit"))
    assert (limit["Fz"] < plain["Fz"]).all()
    for name in set(plain) - set(errors.FORCES):
        np.testing.assert_array_equal(limit[name], plain[name])


def test_a_mesh_without_a_level_counts_by_its_element_size():
    size = {n: settings(mesh={"mesher": "mapped", "n": n, "slip": 0.5}) for n in (8, 16)}
    ratio = [errors.mesh_factor(s, knobs()) for s in size.values()]
    np.testing.assert_allclose(ratio[0] / ratio[1], 4.0, rtol=1e-12)  # second order


@pytest.mark.parametrize("name", ["Fz", "contact_area", "peak_pressure"])
def test_a_small_contact_has_the_larger_relative_error(name):
    found = result()
    relative = stated(found)[name] / found.channels[name]
    assert (np.diff(relative) < 0).all()


def test_force_error_grows_with_what_makes_it_grow():
    plain = stated()["Fz"]
    assert (stated(D1=1.0)["Fz"] > plain).all()  # nearer to incompressible
    assert (stated(at=settings(point=[20.0, 0.0]))["Fz"] > 1.2 * plain).all()
    assert (stated(offset_y=10.0)["Fz"] > 1.2 * plain).all()
    assert (stated(friction=0.5)["Fz"] > plain).all()
    unsettled = result()
    unsettled = replace(unsettled, contact_error=10 * unsettled.contact_error)
    assert (stated(unsettled)["Fz"] > plain).all()
    tilting = replace(result(), residual=np.full(3, 0.005))  # what is out of balance may be missing in the force
    np.testing.assert_allclose((stated(tilting)["Fz"] - plain) / result().channels["Fz"], 0.005, rtol=1e-9)


def test_stated_errors_have_their_channels_dimension():
    """Twice the size and three times the force: the errors follow (the shipped meshes scale with the ball)."""
    small, large = stated(), stated(result(lengths=2.0, forces=12.0), settings(scale=2.0), mu=0.03, D1=5.8 / 3)
    power = {"Fz": 12.0, "uz_max": 2.0, "bulge": 2.0, "contact_area": 4.0, "contact_radius": 2.0,
             "peak_pressure": 3.0, "uz(0.5,0)": 2.0, "uz(6,2)": 2.0}  # fmt: skip
    scaled = {"uz(0.5,0)": "uz(1,0)", "uz(6,2)": "uz(12,4)"}
    for name, factor in power.items():
        np.testing.assert_allclose(large[scaled.get(name, name)], factor * small[name], rtol=1e-12, err_msg=name)


def test_a_patch_too_small_to_be_fitted_is_not_exact():
    found = result()
    lost = {n: 0.0 * found.channels[n] for n in ("contact_area", "contact_radius")}
    error = stated(replace(found, channels=found.channels | lost))
    assert all((error[n] > 0).all() for n in lost)


def test_no_contact_is_no_force_and_no_error_of_it():
    found = result()
    found = replace(found, channels={n: 0.0 * v for n, v in found.channels.items()}, contact_error=np.zeros(3))
    error = stated(found)
    assert all(np.isfinite(v).all() for v in error.values())
    assert not np.any([error[n] for n in (*errors.FORCES, "contact_area", "contact_radius", "peak_pressure")])
