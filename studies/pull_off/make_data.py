"""A record of a ball drawn in by a gel and pulled off again, by the program beside: python make_data.py

The ball has R = 2 mm, the gel μ = 10 kPa and no compressibility; the attraction is 16 mJ/m² over 4 μm (Tabor parameter
1.36).  Travel is controlled at 10 μm/s; the drive stops 44 μm deep and goes back to 40 μm above the gel.  Force is read
to 1.5 μN.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from half_space import curve

R, MU, W, REACH = 2.0, 0.01, 1.6e-5, 4e-3
DEEPEST, ABOVE, SPEED, STEP = 0.044, 0.040, 0.01, 0.001
NOISE, SEED = 1.5e-6, 7


def record() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (s), depth (mm) and force (N)."""
    found = curve(R, W, 4.0 * MU, REACH, 1.05 * DEEPEST, 240)
    (s_in, F_in), (s_off, F_off) = found.way_there(), found.way_back()
    there = np.arange(-ABOVE, DEEPEST + 0.5 * STEP, STEP)
    back = there[-2::-1]
    on = np.interp(there, s_off, F_off)
    first = np.where(there <= s_in[-1], np.interp(there, s_in, F_in), on)
    second = np.where(back >= s_off[0], np.interp(back, s_off, F_off), np.interp(back, s_in, F_in))
    depth, force = np.concatenate([there, back]), np.concatenate([first, second])
    time = np.arange(len(depth)) * STEP / SPEED
    return time, depth, force + np.random.default_rng(SEED).normal(0.0, NOISE, len(depth))


if __name__ == "__main__":
    rows = [f"{t:.2f},{u:.4f},{F:.4e}" for t, u, F in zip(*record(), strict=True)]
    file = Path(__file__).parent / "measured" / "pull_off.csv"
    file.write_text("\n".join(["time_s,depth_mm,Fz_N", *rows]) + "\n", encoding="utf-8")
