import numpy as np

from rso import benchmarks as b
from rso.doe import sobol


def test_variances_and_indices_against_published_numbers():
    # Dakota's examples (Ishigami) and Saltelli's book (g-function), all digits they print.
    first, total = b.ishigami_indices()
    np.testing.assert_allclose(first, [0.313905191147811, 0.442411144790041, 0], atol=1e-14)
    np.testing.assert_allclose(total, [0.557588855209959, 0.442411144790041, 0.243683664062148], atol=1e-14)
    np.testing.assert_allclose(np.var(b.ishigami(sobol(3, 2**14, 0))), 13.844587940719, rtol=2e-3)  # Sobol sample
    first, total = b.sobol_g_indices(np.array([0, 1, 4.5, 9, 99, 99, 99, 99]))
    np.testing.assert_allclose(first[:4], [0.716192, 0.179048, 0.023676, 0.007162], atol=5e-7)
    np.testing.assert_allclose(total[:4], [0.787144, 0.242198, 0.034317, 0.010460], atol=5e-7)


def test_branin_minima():
    x = np.array([[-np.pi, 12.275], [np.pi, 2.275], [3 * np.pi, 2.475]])
    X = (x + np.array([5, 0])) / 15
    np.testing.assert_allclose(b.branin(X), b.BRANIN_MINIMUM, rtol=1e-9)
    assert b.branin(sobol(2, 4096, 0)).min() > b.BRANIN_MINIMUM


def test_zdt_fronts():
    X = np.zeros((101, 5))
    X[:, 0] = np.linspace(0, 1, 101)
    np.testing.assert_allclose(b.zdt1(X)[:, 1], 1 - np.sqrt(X[:, 0]), atol=1e-15)
    np.testing.assert_allclose(b.zdt2(X)[:, 1], 1 - X[:, 0] ** 2, atol=1e-15)


def test_borehole_is_within_its_published_range():
    y = b.borehole(sobol(8, 4096, 0))
    assert 7 < y.min() and y.max() < 310 and 60 < y.mean() < 90


def test_indentation_limits():
    # Hertz, incompressible: F = 16/9 E √R h^1.5 with E = 3μ.
    np.testing.assert_allclose(b.indentation(0.5, 0.01, 0.0, 3.0), 16 / 9 * 0.03 * np.sqrt(3) * 0.5**1.5, rtol=1e-14)
    # K = 2/D1 = 2μ/3 (D1 = 3/μ) means ν = 0: E* = E = 2μ.
    np.testing.assert_allclose(b.indentation(0.5, 0.01, 300.0, 3.0), 4 / 3 * 0.02 * np.sqrt(3) * 0.5**1.5, rtol=1e-14)
    # Dimitriadis' printed series for a bonded incompressible layer (three to four digits), but for the sign of its
    # last term, +0.0975 in print, which their own general formula gives as −0.0975.
    x = np.sqrt(3.0 * 0.5) / 3
    series = 1 + 1.133 * x + 1.283 * x**2 + 0.769 * x**3 - 0.0975 * x**4
    ratio = b.indentation(0.5, 0.01, 0.0, 3.0, thickness=3.0) / b.indentation(0.5, 0.01, 0.0, 3.0)
    np.testing.assert_allclose(ratio, series, rtol=3e-4)  # half a unit of each last digit
    # A half space is a very thick layer: 2·1.8/π·√(Rh)/thickness = 1.4e-9.
    np.testing.assert_allclose(b.indentation(0.5, 0.01, 50.0, thickness=1e9), b.indentation(0.5, 0.01, 50.0), rtol=1e-8)
