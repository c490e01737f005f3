"""The reader of the public nanoindentation curves and its least squares, on a folder of two made curves."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

DEPTHS = np.arange(1, 21) / 40.0


@pytest.fixture(scope="module")
def script():
    path = Path(__file__).parents[2] / "benchmarks" / "nanoindentation.py"
    spec = importlib.util.spec_from_file_location("nanoindentation_benchmark", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def written(folder: Path, sizes: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """Two files as those of the repository, of forces µ (25 µm)² (W + H) depth; returns f (n, 20)."""
    f = sizes.sum(1)[:, None] * DEPTHS
    np.savetxt(folder / "Model_Input_NH_ValPred", np.column_stack([sizes, mu]))
    np.savetxt(folder / "Model_Output_NH_ValPred", (f * mu[:, None] * 6.25e-10).T)
    return f


@pytest.mark.parametrize("below", ["", "data/SynthData"])
def test_moduli_of_made_curves_are_found_again(script, tmp_path, below):
    folder = tmp_path / below
    folder.mkdir(parents=True, exist_ok=True)
    made, mu = np.array([[5.0, 40.0], [22.6, 13.9], [7.0, 8.0]]), np.array([100.0, 9e5, 2e3])
    f = written(folder, made, mu)
    sizes, given, forces = script.read(tmp_path)
    np.testing.assert_array_equal(sizes, made)
    np.testing.assert_array_equal(given, mu)
    np.testing.assert_allclose(script.moduli(forces, f), mu, rtol=1e-12)  # round-off
    # A model that is too stiff by a hundredth finds moduli that are too low by as much.
    np.testing.assert_allclose(script.moduli(forces, 1.01 * f), mu / 1.01, rtol=1e-12)


def test_a_folder_without_them_is_refused(script, tmp_path):
    with pytest.raises(FileNotFoundError, match="PatrickGio/Nanoindentation"):
        script.read(tmp_path)
    written(tmp_path, np.array([[5.0, 5.0], [6.0, 6.0]]), np.array([1.0, 2.0]))
    np.savetxt(tmp_path / "Model_Input_NH_ValPred", np.ones((3, 3)))
    with pytest.raises(ValueError, match=r"should be \(n, 3\) and \(n, 20\)"):
        script.read(tmp_path)


def test_nearest_curves_are_different_ones(script):
    sizes = script.BOX.from_unit(np.array([[0.5, 0.5], [0.1, 0.1], [0.9, 0.9]]))
    assert sorted(script.nearest(np.array([[0.5, 0.5], [0.5, 0.5]]), sizes)) in ([0, 1], [0, 2])
