"""The generator against other numbers: the null force of two published example cases and its own finer elements.

python benchmarks/blind/check.py             library against the examples (no finite elements)
python benchmarks/blind/check.py --fine 0.2  cubic tets with linear pressure at this mu D1 (about a minute)
"""

import argparse

import library
import numpy as np

# noise-free forces at 1, 2, 3, 4 mm of another code (stated accuracy 0.3 to 1 %): mu, D1, force in N
EXAMPLES = {
    "A (null)": (0.007432248648565007, 26.90975631427715, (0.059984, 0.164459, 0.290098, 0.425156)),
    "B (null part)": (0.011768278753229106, 5.948193569156633, (0.09908, 0.269385, 0.471419, 0.684544)),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fine", type=float)
    args = parser.parse_args()
    at = np.array([1.0, 2.0, 3.0, 4.0])
    for name, (mu, D1, force) in EXAMPLES.items():
        F = mu * library.null_curve("top", mu * D1, at)[:, 2]
        print(f"{name:14s} mu D1 {mu * D1:.3f}: difference in % at 1..4 mm", np.round(100 * (F / force - 1), 2))
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
