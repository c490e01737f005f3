"""Predictions of SMT and OpenTURNS on given designs: python peers.py problems.npz predictions.npz

Run by benchmarks/surrogates.py in an environment of its own; it imports nothing of rso.  Problem k of the input is
X{k} (n, d) and y{k} (n,) to learn, Q{k} (m, d) to predict and, where gradients are known, G{k} (n, d), all in the unit
cube.  Every model keeps its package's defaults but for what its name says.
"""

from __future__ import annotations

import contextlib
import io
import sys
import time
import warnings

import numpy as np


def smt_kriging(corr: str, poly: str):
    """Kriging of SMT."""

    def run(X, y, G, Q):
        from smt.surrogate_models import KRG

        model = KRG(corr=corr, poly=poly, print_global=False)
        model.set_training_values(X, y[:, None])
        model.train()
        return model.predict_values(Q)[:, 0]

    return run


def smt_gekpls(components: int, extra: int):
    """Gradient-enhanced kriging with partial least squares of SMT, with `extra` points from each gradient."""

    def run(X, y, G, Q):
        from smt.design_space import DesignSpace
        from smt.surrogate_models import GEKPLS

        d = X.shape[1]
        cube = DesignSpace([[0.0, 1.0]] * d)
        components_here, extra_here = min(components, d), min(extra, d)
        model = GEKPLS(n_comp=components_here, extra_points=extra_here, design_space=cube, print_global=False)
        model.set_training_values(X, y[:, None])
        for j in range(d):
            model.set_training_derivatives(X, G[:, j : j + 1], j)
        model.train()
        return model.predict_values(Q)[:, 0]

    return run


def openturns_kriging(kernel: str, linear: bool):
    """Kriging of OpenTURNS."""

    def run(X, y, G, Q):
        import openturns as ot

        ot.Log.Show(ot.Log.NONE)
        d = X.shape[1]
        basis = ot.LinearBasisFactory(d).build() if linear else ot.ConstantBasisFactory(d).build()
        start = [0.3] * d  # its default, 1, is the whole cube and often stays there
        covariance = ot.SquaredExponential(start) if kernel == "squared_exponential" else ot.MaternModel(start, 2.5)
        starts = ot.LHSExperiment(ot.JointDistribution([ot.LogUniform(np.log(0.1), np.log(10.0))] * d), 10).generate()
        for multi in (True, False):
            fitter = ot.GaussianProcessFitter(ot.Sample(X), ot.Sample(y[:, None]), covariance, basis)
            if multi:
                fitter.setOptimizationAlgorithm(ot.MultiStart(ot.Cobyla(), starts))
            try:
                fitter.run()
                break
            except RuntimeError:  # "none of the local searches succeeded"
                if not multi:
                    raise
        process = ot.GaussianProcessRegression(fitter.getResult())
        process.run()
        return np.array(process.getResult().getMetaModel()(ot.Sample(Q)))[:, 0]

    return run


VALUES = {
    "SMT KRG": smt_kriging("squar_exp", "constant"),
    "SMT KRG linear": smt_kriging("squar_exp", "linear"),
    "SMT KRG Matern": smt_kriging("matern52", "constant"),
    "OpenTURNS SE": openturns_kriging("squared_exponential", False),
    "OpenTURNS SE linear": openturns_kriging("squared_exponential", True),
    "OpenTURNS Matern": openturns_kriging("matern52", False),
}
GRADIENTS = {"SMT GEKPLS 1": smt_gekpls(2, 1), "SMT GEKPLS all": smt_gekpls(8, 8)}


def main(source: str, target: str) -> None:
    """Read problems, write predictions; a model that raises leaves none and its words go to stderr."""
    warnings.simplefilter("ignore")
    problems, found = np.load(source, allow_pickle=False), {}
    for k in sorted(int(name[1:]) for name in problems.files if name[0] == "X"):
        X, y, Q = (problems[f"{a}{k}"] for a in "XyQ")
        G = problems[f"G{k}"] if f"G{k}" in problems.files else None
        for name, run in (VALUES if G is None else GRADIENTS).items():
            start = time.process_time()
            try:
                with contextlib.redirect_stdout(io.StringIO()):
                    found[f"{k}|{name}"] = run(X, y, G, Q)
                found[f"{k}|{name}|cpu"] = np.array(time.process_time() - start)
            except Exception as error:
                print(f"problem {k}, {name}: {type(error).__name__}: {error}", file=sys.stderr)
    np.savez(target, **found)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
