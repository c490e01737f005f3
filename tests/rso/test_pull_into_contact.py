"""A body that draws the indenter in, fitted without attraction: contact and modulus hold the truth, by JKR's forces."""

import numpy as np
import pytest
import sample_studies as studies

from rso.data import Noise, combine, read_measurement
from rso.study.loader import load_study

PLANE_MODULUS, R, DEEPEST, AIR = 0.02, 3.0, 3.0, 2.0  # MPa, mm
SHAPE = 4.0 / 3.0 * R**0.5  # of Hertz
MOST = SHAPE * PLANE_MODULUS * DEEPEST**1.5
STATED = Noise(gain=0.0, correlation=0.0)


def drawn_in(u, pull):
    """Force (N) of a ball at travels u (n,) mm that jumps into contact at 0; pull-off is a share of the largest force.

    Johnson, Kendall & Roberts, Proc. R. Soc. A 324 (1971) 301.
    """
    w = pull * MOST / (1.5 * np.pi * R)
    a = np.linspace(1e-6, 4.0, 40_001)
    depth = a**2 / R - np.sqrt(2.0 * np.pi * w * a / PLANE_MODULUS)
    force = 4.0 * PLANE_MODULUS * a**3 / (3.0 * R) - np.sqrt(8.0 * np.pi * w * PLANE_MODULUS * a**3)
    stable = int(np.argmin(depth))
    return np.where(u < 0.0, 0.0, np.interp(np.maximum(u, 0.0), depth[stable:], force[stable:]))


def written(path, rng, pull, noise):
    u = np.linspace(-AIR, DEEPEST, 161)
    F = drawn_in(u, pull) + noise * MOST * rng.standard_normal(len(u))
    rows = "".join(f"{d + 7.0:.6f},{f:.8f}\n" for d, f in zip(u, F, strict=True))
    path.write_text("Displacement (mm),Force (N)\n" + rows)
    return path


def modulus(m):
    """The modulus over the true one, by Hertz, and its standard deviation, by least squares with the errors stated."""
    c = combine(m, Noise(contact=m.contact, gain=0.0, correlation=0.0))
    f, C = SHAPE * PLANE_MODULUS * c.depth[c.compared] ** 1.5, c.covariance[np.ix_(c.compared, c.compared)]
    weighted = np.linalg.solve(C, f)
    return float(weighted @ c.value[c.compared]) / float(f @ weighted), float(f @ weighted) ** -0.5


SEEN = [(0.08, 0.003), (0.03, 0.003), (0.05, 0.01), (0.12, 0.01)]  # pull and noise, shares of the largest force
HARDLY_SEEN = [(0.0, 0.003), (0.0, 0.01), (0.01, 0.01), (0.02, 0.01)]


@pytest.mark.parametrize(
    "pull, noise", [(0.03, 0.01), *(pytest.param(*v, marks=pytest.mark.verification) for v in (*SEEN, *HARDLY_SEEN))]
)
def test_contact_and_modulus_are_within_what_is_stated(tmp_path, pull, noise, request):
    """Without the pull a contact was 0.18 ± 0.06 mm late, a modulus 16 ± 2 % too small; both beyond what was stated."""
    rng, late, off = np.random.default_rng(1), [], []
    for _ in range(50 if request.node.get_closest_marker("verification") else 8):
        m = read_measurement(written(tmp_path / "a.csv", rng, pull, noise))
        late.append((DEEPEST - float(m.repeats[0].depth.max())) / m.contact)
        found, sd = modulus(m)
        off.append(abs(found - 1.0) / np.hypot(sd, 0.005))  # JKR's force is not quite Hertz's less a constant
        assert abs(found - 1.0) < 0.05
    assert np.mean(np.abs(late) < 1.645) > 0.75
    # a pull that is no more than scatter is hardly seen, and nothing else is off here
    assert np.mean(np.array(off) < 1.645) > 0.6


def test_a_pull_is_said_and_one_that_is_not_there_is_not(tmp_path):
    rng = np.random.default_rng(2)
    for pull, noise, words in ((0.08, 0.003, "Fz falls by"), (0.03, 0.01, "by the shape of Fz the body draws")):
        m = read_measurement(written(tmp_path / "a.csv", rng, pull, noise))
        assert any(words in d and "counts as an error of all forces" in d for d in m.doubts)
        assert m.repeats[0].pull == pytest.approx(0.89 * pull * MOST, rel=0.4)  # 4/3 π w R of 3/2 at a depth of 0
    for _ in range(5):
        m = read_measurement(written(tmp_path / "b.csv", rng, 0.0, 0.01))
        assert not any("draws" in d for d in m.doubts) and m.repeats[0].pull < 0.01 * MOST


def test_a_model_that_states_adhesion_has_no_such_error(tmp_path):
    written(tmp_path / "top.csv", np.random.default_rng(3), 0.08, 0.003)
    parameters = studies.SECTIONS["parameters"]
    for more, counts in (("", True), ("\nadhesion = { value = 0 }", False)):
        study = load_study(studies.write(tmp_path, parameters=parameters + more))
        assert ("pull" in combine(study.measurement("top"), study.noise_of("top")).usual) is counts
