"""The generator against other numbers: the null force of two published example cases and its own finer elements.

python benchmarks/blind/check.py             library against the examples (no finite elements)
python benchmarks/blind/check.py --fine 0.2  cubic tets with linear pressure at this mu D1 (about a minute)
python benchmarks/blind/check.py --deep      are the deep runs of three effects smooth to their end? (some minutes)
python benchmarks/blind/check.py --turned    misalignment and tilt against what is known of them (about ten minutes)
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


def turned():
    """Limits, symmetries, a place reached another way (half models); coarser elements (whole models)."""
    import solve
    from numpy.polynomial.polynomial import polyval

    d, muD1 = np.array([1.0, 2.0, 3.0, 4.0]), 0.13

    def change(place, offset=(0, 0), tilt=(0, 0), h=None):
        table = solve.turned(muD1, offset, np.radians(tilt), [place], h)[place]
        return polyval(d, table["ratio"]), polyval(d, table["lean"])

    def tell(what, ratio, lean):
        print(f"{what}: Fz {np.round(100 * ratio, 2)} %, lean {np.round(100 * lean, 3).tolist()} %", flush=True)

    ratio, lean = change("top")
    tell("nothing", ratio - 1, lean)
    assert not (ratio - 1).any() and not lean.any()
    top, far = library.null_curve("top", muD1, d), library.null_curve("20_0", muD1, d)
    ratio, lean = change("top", (20, 0))
    error = ratio / (far[:, 2] / top[:, 2]) - 1, lean[0] - far[:, 0] / far[:, 2]
    tell("offset_x 20 at the top, off (20, 0) by", *error)
    assert np.abs(error[0]).max() < 0.01 and np.abs(error[1]).max() < 0.005
    sizes = {s: change("top", tilt=(0, s)) for s in (5, -5, 0.5)}
    for size, (ratio, lean) in sizes.items():
        tell(f"tilt_y {size} at the top", ratio - 1, lean[0])
    (up, down, small), lean = (sizes[s][0] for s in (5, -5, 0.5)), [sizes[s][1][0] for s in (5, -5, 0.5)]
    assert np.abs(up / down - 1).max() < 0.0005 and np.abs(lean[0] + lean[1]).max() < 0.002 * np.abs(lean[0]).max()
    assert np.abs(small - 1).max() < 0.001 and np.abs(10 * lean[2] / lean[0] - 1).max() < 0.02
    ratio, lean = change("top", tilt=(5, 0))
    tell("tilt_x 5 at the top", ratio - 1, lean[1])  # a body of revolution about x, but for its holder
    assert np.abs(ratio - 1).max() < 0.005
    both = [change("20_0", (0, 3), h=h) for h in (solve.WHOLE, 1.3)]
    for ratio, lean in both:
        tell("offset_y 3 at (20, 0), whole models with finer, coarser elements", ratio - 1, lean)
    assert np.abs(both[0][0] / both[1][0] - 1).max() < 0.001 and np.abs(both[0][1] - both[1][1]).max() < 0.002


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fine", type=float)
    parser.add_argument("--deep", action="store_true")
    parser.add_argument("--turned", action="store_true")
    args = parser.parse_args()
    at = np.array([1.0, 2.0, 3.0, 4.0])
    for name, (mu, D1, force) in EXAMPLES.items():
        F = mu * library.null_curve("top", mu * D1, at)[:, 2]
        print(f"{name:14s} mu D1 {mu * D1:.3f}: difference in % at 1..4 mm", np.round(100 * (F / force - 1), 2))
    if args.deep:
        deep()
    if args.turned:
        turned()
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
