"""The generator against other numbers: the null force of two published example cases and its own finer elements.

python benchmarks/blind/check.py             library against the examples (no finite elements)
python benchmarks/blind/check.py --fine 0.2  cubic tets with linear pressure at this mu D1 (about a minute)
python benchmarks/blind/check.py --deep      are the deep runs of three effects smooth to their end? (some minutes)
"""

import argparse

import library
import numpy as np

# noise-free forces at 1, 2, 3, 4 mm of another code (stated accuracy 0.3 to 1 %): mu, D1, force in N
EXAMPLES = {
    "A (null)": (0.007432248648565007, 26.90975631427715, (0.059984, 0.164459, 0.290098, 0.425156)),
    "B (null part)": (0.011768278753229106, 5.948193569156633, (0.09908, 0.269385, 0.471419, 0.684544)),
}


def deep():
    """Largest break (relative to the force) beyond 4 mm of a few effects, and of a force with a jump put in."""
    import solve

    for name, changes in {
        "delta_b -3": {"axes": (1, 1 - 3 / 35, 1)},
        "delta_b +3": {"axes": (1, 1 + 3 / 35, 1)},
        "adhesion": {"adhesion": 0.01, "adhesion_range": 0.2},
    }.items():
        table = solve.tables(0.13, changes)[0]["top", "load"]
        d, F = np.array(table["d"]), np.array(table["F"])[:, 2]
        ratio = F / library.raw("top", 0.13, d)[:, 2] / library.correction("top", 0.13, d)
        broken = ratio * (1 + 0.01 * (d == d[-1]))
        own, put = (np.abs(solve.breaks(d, r))[d > 4].max() for r in (ratio, broken))
        print(f"{name}: to {d[-1]} mm, largest break {own:.1e}; with a jump of 1 % at the end {put:.1e}", flush=True)
        assert own <= solve.BREAK < put


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fine", type=float)
    parser.add_argument("--deep", action="store_true")
    args = parser.parse_args()
    at = np.array([1.0, 2.0, 3.0, 4.0])
    for name, (mu, D1, force) in EXAMPLES.items():
        F = mu * library.null_curve("top", mu * D1, at)[:, 2]
        print(f"{name:14s} mu D1 {mu * D1:.3f}: difference in % at 1..4 mm", np.round(100 * (F / force - 1), 2))
    if args.deep:
        deep()
    if args.fine:
        import fe
        import ngsolve as ng

        ng.SetNumThreads(1)
        path = fe.Experiment(fe.Model(muD1=args.fine), h=1.2, order=3).press([(2 * d, d) for d in fe.TOP_DEPTHS])
        table = library.as_table(path)
        own = library.null_curve("top", args.fine, np.array(table["d"]))[:, 2]
        ratio = 100 * (own / np.array(table["F"])[:, 2] - 1)
        print("library against cubic tets, %:", dict(zip(table["d"], np.round(ratio, 2).tolist(), strict=True)))


if __name__ == "__main__":
    main()
