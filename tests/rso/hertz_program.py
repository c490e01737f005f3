"""A program with an input file: a ball on an incompressible half-space by Hertz, in decks and results as CalculiX has.

``hertz_program.py JOB`` reads JOB.inp and writes JOB.dat, JOB.csv and JOB.log (of FEBio's form).  Of the deck it takes
the constants beneath *HYPERELASTIC and the travels beneath *BOUNDARY; from 9 mm on it stops, as a solver would.
"""

import itertools
import sys
from pathlib import Path

R, DEEPEST = 3.0, 9.0


def force(mu: float, travel: float) -> float:
    """F = 16/3 mu sqrt(R) u^(3/2) for nu = 1/2 (Johnson, Contact Mechanics, eq. 4.23)."""
    return 16.0 / 3.0 * mu * R**0.5 * travel**1.5


def numbers(line: str) -> list[float]:
    return [float(word) for word in line.split(",")]


def main(job: str) -> int:
    lines = Path(f"{job}.inp").read_text().splitlines()
    mu = 2.0 * next(numbers(below)[0] for line, below in itertools.pairwise(lines) if line.startswith("*HYPERELASTIC"))
    steps = [line for line in lines if line.startswith("BALLNODES, 2, 2,")]
    dat, csv, log = "", "step;u2;rf2\n", ""
    for k, line in enumerate(steps, 1):
        u = -float(line.split(",")[3])
        if u >= DEEPEST:
            print(" *ERROR: increment size smaller than minimum\n best solution and residuals are in the frd file")
            Path(f"{job}.dat").write_text(dat)
            return 201
        for share in (0.25, 1.0):  # increments within a step
            before = -float(steps[k - 2].split(",")[3]) if k > 1 else 0.0
            here = before + share * (u - before)
            F = force(mu, here)
            head = f" total force (fx,fy,fz) for set BALLNODES and time  {k - 1 + share:.7E}"
            dat += f"\n{head}\n\n        1.234560E-04 {-F: .6E} -1.300000E-14\n"
            csv += f"{k};{-here:.9g};{-1000.0 * F:.9g}\n"
            log += f"*Step  = {k}\n*Time  = {here / 0.5:.9g}\n*Data  = Rx;Ry;Rz\n"
            log += f"1 0 0 {0.25 * F:.9g}\n2 0 0 {0.75 * F:.9g}\n"
    Path(f"{job}.dat").write_text(dat)
    Path(f"{job}.csv").write_text(csv)
    Path(f"{job}.log").write_text(log)
    print(f"the reaction is {force(mu, 1.0)}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
