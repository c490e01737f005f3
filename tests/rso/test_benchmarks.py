import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from rso import benchmarks as b
from rso.doe import sobol_sequence


def test_variances_and_indices_against_published_numbers():
    # Dakota's examples (Ishigami) and Saltelli's book (g-function), all digits they print.
    first, total = b.ishigami_indices()
    np.testing.assert_allclose(first, [0.313905191147811, 0.442411144790041, 0], atol=1e-14)
    np.testing.assert_allclose(total, [0.557588855209959, 0.442411144790041, 0.243683664062148], atol=1e-14)
    np.testing.assert_allclose(
        np.var(b.ishigami(sobol_sequence(3, 2**14, 0))), 13.844587940719, rtol=2e-3
    )  # Sobol sample
    first, total = b.sobol_g_indices(np.array([0, 1, 4.5, 9, 99, 99, 99, 99]))
    np.testing.assert_allclose(first[:4], [0.716192, 0.179048, 0.023676, 0.007162], atol=5e-7)
    np.testing.assert_allclose(total[:4], [0.787144, 0.242198, 0.034317, 0.010460], atol=5e-7)


def test_branin_minima():
    x = np.array([[-np.pi, 12.275], [np.pi, 2.275], [3 * np.pi, 2.475]])
    X = (x + np.array([5, 0])) / 15
    np.testing.assert_allclose(b.branin(X), b.BRANIN_MINIMUM, rtol=1e-9)
    assert b.branin(sobol_sequence(2, 4096, 0)).min() > b.BRANIN_MINIMUM


def test_zdt_fronts():
    X = np.zeros((101, 5))
    X[:, 0] = np.linspace(0, 1, 101)
    np.testing.assert_allclose(b.zdt1(X)[:, 1], 1 - np.sqrt(X[:, 0]), atol=1e-15)
    np.testing.assert_allclose(b.zdt2(X)[:, 1], 1 - X[:, 0] ** 2, atol=1e-15)


def test_borehole_is_within_its_published_range():
    y = b.borehole(sobol_sequence(8, 4096, 0))
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


def test_the_front_of_zdt3_is_below_every_point_of_the_cube():
    X = np.zeros((2001, 5))
    X[:, 0] = np.linspace(0, 1, 2001)
    front = b.zdt3(X)
    np.testing.assert_allclose(front[:, 1], 1 - np.sqrt(X[:, 0]) - X[:, 0] * np.sin(10 * np.pi * X[:, 0]), atol=1e-14)
    # The hypervolume by sorting instead of by quadrature; 2001 points are 1e-3 apart.
    order = np.argsort(front[:, 0])
    lowest = np.minimum.accumulate(front[order, 1])
    area = np.sum(np.diff(np.append(front[order, 0], 1.1)) * (1.1 - lowest))
    np.testing.assert_allclose(b.zdt3_hypervolume(), area, atol=2e-3)
    assert np.all(
        b.zdt3(sobol_sequence(5, 512, 0))[:, 1]
        >= np.interp(sobol_sequence(5, 512, 0)[:, 0], front[:, 0], front[:, 1]) - 1e-3
    )


def script():
    path = Path(__file__).parents[2] / "benchmarks" / "surrogates.py"
    spec = importlib.util.spec_from_file_location("surrogates_benchmark", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_the_published_mooney_rivlin_fit_is_the_relative_one():
    relative, absolute = script().rubber()[1:]
    # All digits that the guide prints; the absolute fit is another one.
    assert "1.338856, 0.5236214, -0.01648364" in relative and "1.93967e-05" in relative.replace(
        "1.9397e-05", "1.93967e-05"
    )
    assert "1.283033" in absolute
    with pytest.raises(ValueError, match="choose absolute or relative"):
        b.mooney_rivlin3([0.1], [1.0], "both")


def test_the_comparison_in_small_without_peers():
    s = script()
    lines, found = s.compare("Kriging", (s.VALUES[0],), 2, None, False, 256)
    (errors,) = found.values()
    # SMT reached 0.067 and OpenTURNS 0.082 on these designs (median of ten).
    assert np.median(errors["rso kriging"]) < 0.06 and len(errors["rso auto"]) == 2 and len(lines) >= 4
    _, found = s.compare("Gradients", (s.GRADIENTS[2],), 2, None, True, 256)
    (errors,) = found.values()
    assert np.median(errors["rso kriging, gradients"]) < 0.5 * np.median(errors["rso kriging"])


def test_bands_in_small():
    s = script()
    lines, found = s.bands((s.BANDS[1],), 3, 256)
    assert found.shape == (1, 3, 2, 2) and len(lines) == 3 and " -> " in lines[-1]
    assert np.all(found[0, :, 1, 0] >= found[0, :, 0, 0])  # a wider band holds no less


def test_gradients_of_the_benchmark():
    X = np.array([[0.3, 0.7], [0.0, 1.0], [1.0, 0.0]])
    G = script().gradient(lambda X: np.sin(X[:, 0]) * X[:, 1] ** 2, X)
    exact = np.column_stack([np.cos(X[:, 0]) * X[:, 1] ** 2, 2 * np.sin(X[:, 0]) * X[:, 1]])
    np.testing.assert_allclose(G, exact, atol=1e-8)  # h² and rounding/h
