"""Order in which the sealed cases of a round are answered, so that every prefix of it is in proportion.

    python benchmarks/blind/order.py DIR [DIR ...] --out FILE

Cases of a kind (null; single, pair and outside, each with and without finite elements) and a folder are put in random
order and spread evenly over the whole: the k-th of n at (k + U)/n with U uniform.  FILE holds "FOLDER CASE", a line
each.  Only cases whose hash is in `hashes.txt` are in it.  Nothing of a truth is printed.
"""

import argparse
import json
import secrets
from pathlib import Path

import numpy as np
from generate import cost


def spread(cases, rng):
    """[(place between 0 and 1, id)] of the cases of one folder."""
    strata = {}
    for c in cases:
        strata.setdefault((c["kind"], cost(c) > 0), []).append(c["id"])
    return [
        ((k + rng.uniform()) / len(ids), name)
        for _, ids in sorted(strata.items())
        for k, name in enumerate(rng.permutation(ids))
    ]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    rng = np.random.default_rng(secrets.randbits(128))
    lines = []
    for folder in args.folders:
        made = {line.split()[0] for line in (folder / "hashes.txt").read_text().splitlines()}
        plan = json.loads((folder / "sealed" / "plan.json").read_text())
        lines += [(at, f"{folder.name} {name}") for at, name in spread([c for c in plan if c["id"] in made], rng)]
    args.out.write_text("".join(f"{line}\n" for _, line in sorted(lines)))


if __name__ == "__main__":
    main()
