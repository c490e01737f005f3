"""Find the measured middle-point curve of EM II again, from the error norms that the thesis prints.

The thesis shows its curve as a figure only.  It prints what 81 simulations of known (μ, D₁) were wrong by against it
(38 NRMSE, 43 MRE), a table of four sets, the same norms of the constant mean (0.6835, 0.5916) and Fz(4 mm) = 0.546 N.
Simulating those sets again says how far the curve lies from 81 known curves: `rso.norms` finds it.

Run: python studies/kidney_em2/reconstruct.py [--jobs 2] [--out FOLDER]
It prints all results and writes measured/ and thesis/reconstruction.png.  The simulations (some minutes of computing)
are kept in results/reconstruction; a second run takes about two minutes.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import other_tests
import reconstruction_figure
import simulated
import trilateration
from scipy.special import ndtr
from simulated import Support, Table
from trilateration import Curve, Lists, crossings, residuals, rms

from rso.norms import TrilaterationFit, TrilaterationProblem, fit_trilateration

HERE = Path(__file__).parent
STORE = HERE / "results" / "reconstruction"
GOOD = 5.0  # cases are averaged whose ln Z is not lower by more
HALF_DIGIT = 0.0005  # N, the last printed digit
Tables = dict[Support, Table]
SEED = trilateration.SEED


def gaussian(p: TrilaterationProblem, seed: int = SEED, n: int = 2000) -> tuple[TrilaterationFit, Curve]:
    """Most probable curve and draws of its Gaussian approximation."""
    found = fit_trilateration(p, seed)
    x = found.draws(n, seed)
    return found, Curve(p.shape.u, p.shape(p.split(x)[0]), x, found.log_evidence)


def out_of_sample(data: Lists, tables: Tables) -> tuple[np.ndarray, np.ndarray]:
    """(a) The NRMSE list alone predicts what was not used; returns the MRE list (43,) and its deviation, in a bowl."""
    print("\n(a) fitted to the 38 NRMSE alone; predicted, not fitted: MRE list and Table 5.1")
    for held in (False, True):
        p = trilateration.problem(data, tables, held, "nrmse")
        _, curve = gaussian(p)
        s = np.median(p.split(curve.x)[2][:, 0])
        r = residuals(p, curve, data.nrmse)
        print(f"  {'held' if held else 'bowl'}: scale {s:.4f}; NRMSE list rms {rms(r, data.nrmse.weight):.4f}")
        for q in (data.mre, *data.table, data.means[1]):
            drawn, r = p.predict(curve.x, [q])[0], residuals(p, curve, q)
            wide = np.sqrt(np.var(drawn, axis=0) + s**2 * 2.0)  # Student's variance with 4 degrees of freedom
            inside = np.average(np.abs(r) < 1.64 * wide, weights=q.weight)
            print(
                f"    {q.kind:6s} ({len(r):2d}) rms {rms(r, q.weight):.4f}  median {np.median(np.abs(r)):.4f}  "
                f"in the 90 % band {100 * inside:3.0f} %  band ±{1.64 * np.median(wide):.4f}"
            )
            if q is data.mre and not held:
                alone = q.value + r, wide
    return alone


def words(data: Lists, p: TrilaterationProblem, curve: Curve) -> None:
    """(b) What the thesis says in words; none of it was used."""
    print("\n(b) in words (not used)")
    some = curve.x[::8]
    y, f = p.shape(p.split(some)[0]), p.known(p.split(some)[1])
    last = len(data.theta) - 4
    for name, said in ((1, "crosses twice"), (3, "crosses near 1.5 mm"), (4, "always below")):
        found = crossings(y, f[:, last + name - 1], curve.u)
        count = np.bincount([len(c) for c in found], minlength=4)[:4] / len(found)
        first = np.array([c[0] for c in found if len(c)] or [np.nan])
        second = np.array([c[1] for c in found if len(c) > 1] or [np.nan])
        print(
            f"  set {name} ({said}): P(0, 1, 2, 3 crossings) = {', '.join(f'{c:.2f}' for c in count)}; "
            f"first {first.mean():.2f} ± {first.std():.2f} mm, second {second.mean():.2f} ± {second.std():.2f} mm"
        )
    k = 2  # 0.3 mm
    steeper = np.mean(np.all(y[:, None, k] > f[:, last:, k], axis=1))
    stiffest = np.max(np.mean(f[:, :, k], axis=0))
    print(f"  steeper than sets 1-4 over the first 0.3 mm: P = {steeper:.2f}")
    print(f"  force at 0.3 mm {np.mean(y[:, k]):.4f} N; of the simulations at most {stiffest:.4f} N")


def supports(data: Lists, tables: Tables) -> dict[str, tuple[TrilaterationProblem, TrilaterationFit, Curve]]:
    """(c) Bowl or held, grids and priors: evidence and residuals."""
    print("\n(c) support, grid and prior, from everything printed (ln Z relative to the bowl on 0.1-4 mm)")
    cases = {
        "bowl": trilateration.problem(data, tables),
        "held": trilateration.problem(data, tables, held=True),
        "bowl, u = 0 a point": trilateration.problem(data.moved(1), tables),
        "bowl, every 0.05 mm": trilateration.problem(data, tables, spacing=0.05),
    }
    p = cases["bowl"]
    for name, more in (("bowl, smoother", {"length": 0.8}), ("bowl, rougher", {"length": 0.35, "knots": 14})):
        cases[name] = replace(p, shape=replace(p.shape, **more))
    out = {name: (p, *gaussian(p)) for name, p in cases.items()}
    for name, (p, found, curve) in out.items():
        a, b = residuals(p, curve, p.printed[0]), residuals(p, curve, p.printed[1])
        print(
            f"  {name:20s} ln Z {found.log_evidence - out['bowl'][1].log_evidence:+7.1f}   "
            f"NRMSE rms {rms(a, data.nrmse.weight):.4f} median {np.median(np.abs(a)):.4f}   "
            f"MRE rms {rms(b, data.mre.weight):.4f} median {np.median(np.abs(b)):.4f}   "
            f"ν {np.round(p.split(found.x[None])[1][0], 1).tolist()}"
        )
    worst = np.argsort(-np.abs(residuals(*out["bowl"][::2], data.nrmse)))[:3]
    print("  worst of the NRMSE list (μ, D₁, printed, predicted):")
    for k in worst:
        r = residuals(*out["bowl"][::2], data.nrmse)[k]
        print(f"    {data.theta[k].tolist()}  {data.nrmse.value[k]:.4f}  {data.nrmse.value[k] + r:.4f}")
    return out


def found(p: TrilaterationProblem, curve: Curve) -> None:
    """What else the norms say of the thesis's simulations."""
    ν = p.split(curve.x)[1]
    penetration = simulated.DEEPEST_PENETRATION * ndtr(ν[:, 2])
    rows = {
        "level (%)": 100 * simulated.LEVEL_SD * ν[:, 0],
        "tilt (%)": 100 * simulated.TILT_SD * ν[:, 1],
        "penetration at 4 mm (mm)": penetration,
        "its power of the force": ndtr(ν[:, 3]),
        "clearance (mm)": p.known.clearance(ν[:, 4]),
    }
    print("  found along with it, 5 % / median / 95 %, against all of the range beforehand:")
    for name, v in rows.items():
        print(f"    {name}: {' / '.join(f'{q:.2f}' for q in np.quantile(v, (0.05, 0.5, 0.95)))}")


def controls(fits: dict[str, tuple[TrilaterationProblem, TrilaterationFit, Curve]], n: int = 3) -> None:
    """(d) Norms made up with one support reject the other; a known curve is found again within its band."""
    print("\n(d) norms made up for a known curve, with the noise found and nuisances drawn from their prior")
    inside, error = [], []
    p, _, curve = fits["bowl"]
    z, _, scales = p.split(curve.x)
    for truth, rival in (("bowl", "held"), ("held", "bowl")):
        gain = []
        for k in range(n):
            rng = np.random.default_rng([SEED, k, len(truth), truth == "held"])
            right, wrong = fits[truth][0], fits[rival][0]
            nuisances = rng.standard_normal(right.nuisances)
            x = np.concatenate([z[97 * k], nuisances, curve.x[97 * k, -scales.shape[1] :]])
            made = trilateration.made_up(right, x, rng)
            mine, again = gaussian(TrilaterationProblem(right.shape, right.known, right.nuisances, made), SEED + k)
            other = fit_trilateration(TrilaterationProblem(wrong.shape, wrong.known, wrong.nuisances, made), SEED + k)
            gain.append(mine.log_evidence - other.log_evidence)
            y = right.shape(z[97 * k])[0]
            inside.append(np.abs(again.mean - y)[:-1] < 1.645 * again.sd[:-1])
            error.append((again.mean - y)[:-1])
        print(f"  made with {truth}: ln Z({truth}) - ln Z({rival}) = {', '.join(f'{g:.1f}' for g in gain)}")
    print(
        f"  known curves: rms error {1e3 * rms(np.array(error)):.2f} mN, "
        f"{100 * np.mean(inside):.0f} % of their points in the 90 % band"
    )


def notes(curve: Curve, ell: float, data: Lists, p: TrilaterationProblem) -> list[str]:
    """Header of the file."""
    a, b = residuals(p, curve, data.nrmse), residuals(p, curve, data.mre)
    return [
        "NOT A RECORD: a reconstruction. The measured curve is not printed in the source, a figure shows it.",
        "Found from what is printed: the NRMSE of 38 and the MRE of 43 simulations of known (mu, D1) against it, the",
        "RRMSE of four sets, the norms of the constant mean (0.6835, 0.5916) and Fz(4 mm) = 0.546 N. The sets were",
        "simulated again in a bowl (clearance, contact penetration and level found along with the curve), the",
        "logarithmic slope of the curve is smooth. Mean and standard deviation of the posterior, averaged over two",
        "grids and three degrees of smoothness.",
        f"Printed and reconstructed norms differ by {rms(a, data.nrmse.weight):.4f} (NRMSE, rms) and "
        f"{np.median(np.abs(b)):.4f} (MRE, median).",
        f"Its errors belong together along the depth, about as exp(-|du|/{ell:.1f} mm). They are those of finding the",
        "curve again; what the sensor got wrong is in the curve itself.",
        "Made by reconstruct.py; change that, not this file.",
    ]


def main() -> None:
    """Everything, in the order of the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=1, help="simulations at a time")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of measured/ and thesis/")
    args = parser.parse_args()
    tables = simulated.tables(STORE, simulated.GRID, args.jobs)
    data = trilateration.lists()
    friction = simulated.friction_matters(STORE, simulated.GRID[7:], args.jobs)
    print(f"friction 0.2 in the bowl changes the force by at most {100 * np.max(np.abs(friction)):.2f} % beyond 0.4 mm")
    print(
        f"{len(data.nrmse.value)} NRMSE ({data.nrmse.weight.sum():g} votes), "
        f"{len(data.mre.value)} MRE ({data.mre.weight.sum():g} votes)"
    )
    alone = out_of_sample(data, tables)
    fits = supports(data, tables)
    p = fits["bowl"][0]
    _, curve = trilateration.reconstruct(p)
    words(data, p, curve)
    found(p, curve)
    controls(fits)

    good = [n for n, (_, f, _) in fits.items() if f.log_evidence > fits["bowl"][1].log_evidence - GOOD]
    final = replace(curve, draws=np.concatenate([fits[n][2].at(curve.u) for n in good]))
    apart = (curve.mean - fits["bowl"][2].mean)[:-1] / curve.sd[:-1]
    ratio = curve.sd[:-1] / fits["bowl"][2].sd[:-1]
    print(
        f"\nchain against Gaussian: at most {np.max(np.abs(apart)):.2f} standard deviations apart, their ratio "
        f"{ratio.min():.2f} to {ratio.max():.2f}"
    )
    ell = trilateration.length(final)
    print(f"curve, average of: {'; '.join(good)}")
    print(f"  standard deviation {1e3 * final.sd[:-1].min():.1f} to {1e3 * final.sd.max():.1f} mN, ℓ = {ell:.1f} mm")
    print(f"  held instead: at most {1e3 * np.max(np.abs(fits['held'][2].mean - final.mean)):.1f} mN away")
    for k in range(4, 40, 5):
        print(f"  {final.u[k]:.1f} mm  {final.mean[k]:.4f} ± {final.sd[k]:.4f} N")
    measured = args.out / "measured"
    sigma = np.maximum(final.sd, HALF_DIGIT)
    trilateration.write(measured, "middle_point.csv", notes(curve, ell, data, p), final.u, final.mean, sigma)
    other_tests.report(measured, STORE, args.jobs, p, curve)
    reconstruction_figure.draw(args.out / "thesis" / "reconstruction.png", data, final, p, curve, alone)


if __name__ == "__main__":
    main()
