"""Point clouds of a whole surface: reading, thinning, noise that goes together, fit, prediction, maps."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import indentation_backend
import numpy as np
import pytest
import sample_studies as studies
from scipy import stats

from rso.calibration.plan import make_plan
from rso.cli.checking import check_lines
from rso.data import Noise, read_measurement, surface_cloud
from rso.data.clouds import most_informative
from rso.doe import Box
from rso.inference import Data, Misfit, Model, gauss_newton
from rso.report import render
from rso.report.calibration.cloud_maps import cloud_maps
from rso.report.calibration.figures import draw
from rso.study.errors import StudyError
from rso.study.loader import load_study

SIGMA, LENGTH, DEPTHS = 0.002, 2.0, (1.0, 1.5, 2.0)
C = studies.MU * studies.D1
NOISE = 'noise = { uz = "2 um", surface_correlation = "2 mm", contact = 0 }'
FEW = NOISE + "\npoints = 10"
CLOUD = '\n[[experiments]]\nname = "cloud"\nrole = "{}"\nkind = "surface"\ndata = "cloud.csv"\n'
TOP = studies.SECTIONS["[experiments]"]
MARKED = 'use = "indentation_backend:MARKED"'
STATED = Noise(uz=SIGMA, surface_correlation=LENGTH, contact=0.0)


def grid(n: int = 15, half: float = 8.0) -> np.ndarray:
    """Places (n², 2) mm."""
    g = np.linspace(-half, half, n)
    return np.stack([v.ravel() for v in np.meshgrid(g, g)], axis=1)


def exact(places: np.ndarray, h: float, c: float = C) -> np.ndarray:
    """Displacements (3, n) mm of the closed form."""
    x, y = places.T
    return np.stack(
        [studies.sideways(h, x, x, y, c), studies.sideways(h, y, x, y, c), studies.displacement(h, x, y, c)]
    )


def text(places: np.ndarray, noise: np.random.Generator | None = None, depths=DEPTHS, length: float = LENGTH) -> str:
    """A file of a cloud; noise by the Cholesky factor of its correlation, written down here once more."""
    n, rows = len(places), []
    apart = np.sqrt(((places[:, None] - places[None]) ** 2).sum(-1))
    L = np.linalg.cholesky(np.exp(-apart / length) + 1e-12 * np.eye(n))
    for h in depths:
        u = exact(places, h) + (0.0 if noise is None else SIGMA * (L @ noise.standard_normal((n, 3))).T)
        rows += [",".join(map(repr, map(float, r))) for r in zip(np.full(n, h), *places.T, *u, strict=True)]
    return "depth_mm,x_mm,y_mm,ux_mm,uy_mm,uz_mm\n" + "\n".join(rows) + "\n"


@pytest.fixture
def marked(tmp_path, monkeypatch) -> Path:
    """A folder with a noisy cloud, and a backend that moves points of the surface."""
    monkeypatch.setattr(indentation_backend, "MARKED", studies.Marked(), raising=False)
    (tmp_path / "cloud.csv").write_text(text(grid(), np.random.default_rng(1)))
    return tmp_path


def read(folder: Path, content: str, noise: Noise = STATED, components=("ux", "uy", "uz"), points: int = 30):
    (folder / "c.csv").write_text(content)
    return surface_cloud(read_measurement(folder / "c.csv"), noise, components, points)


# ----------------------------------------------------------------------------------------------------------- reading


def test_readings_that_are_kept_are_those_of_the_file(tmp_path):
    cloud = read(tmp_path, text(grid()))
    assert (cloud.points, cloud.seen, cloud.lost, cloud.images, cloud.taken) == (30, 225, 0, 3, 3)
    assert len(cloud.value) == 30 * 3 * 3
    for u, p, c, v in zip(cloud.depth, cloud.position, cloud.component, cloud.value, strict=True):
        assert v == pytest.approx(exact(p[None], u)[("ux", "uy", "uz").index(c), 0], abs=1e-9)  # places are rounded so


def test_the_covariance_is_the_sum_of_its_parts(tmp_path):
    """Entry by entry from the formula, with every part present."""
    noise = Noise(uz=0.003, ux=0.001, uy=0.002, surface_correlation=1.5, camera=0.0005, depth=0.01, contact=0.02)
    cloud = read(tmp_path, text(grid(5), depths=(1.0, 2.0)), noise, points=6)
    size = {"ux": 0.001, "uy": 0.002, "uz": 0.003}
    tables = {}  # u = a d + b d² through both images
    for u, p, c, v in zip(cloud.depth, cloud.position, cloud.component, cloud.value, strict=True):
        tables.setdefault((c, *p), {})[u] = v
    slope = {}
    for key, at in tables.items():
        b = (at[2.0] / 2.0 - at[1.0]) / 1.0
        a = at[1.0] - b
        slope |= {(*key, 1.0): a + 2 * b, (*key, 2.0): a + 4 * b}
    rows = list(zip(cloud.component, cloud.position, cloud.depth, strict=True))
    for i, (c, p, u) in enumerate(rows):
        for j, (d, q, v) in enumerate(rows):
            expected = (0.02**2 + 0.01**2 * (u == v)) * slope[(c, *p, u)] * slope[(d, *q, v)]
            if c == d and u == v:
                expected += size[c] ** 2 * np.exp(-np.hypot(*(p - q)) / 1.5) + 0.0005**2
            assert cloud.covariance[i, j] == pytest.approx(expected, rel=1e-9, abs=1e-18)


@pytest.mark.parametrize("clouds", [60, pytest.param(200, marks=pytest.mark.verification)])
def test_a_right_model_is_refuted_as_seldom_as_is_said(tmp_path, clouds):
    """χ² of the truth at 30 kept points of many clouds: p below 1 % and 5 % as often, to 2.5 of their σ.

    A choice of points by their own readings, as it was once, prefers large errors: 3 % and 8.5 %.
    """
    p = []
    for seed in range(clouds):
        cloud = read(tmp_path, text(grid(), np.random.default_rng(1000 + seed)))
        rows = zip(cloud.depth, cloud.position, cloud.component, strict=True)
        off = cloud.value - [exact(q[None], u)[("ux", "uy", "uz").index(c), 0] for u, q, c in rows]
        p.append(stats.chi2.sf(off @ np.linalg.solve(cloud.covariance, off), len(off)))
    for level in (0.01, 0.05):
        assert np.mean(np.array(p) < level) < level + 2.5 * np.sqrt(level * (1 - level) / clouds)


def test_points_that_are_missing_at_a_depth_are_left_out_and_counted(tmp_path):
    lines = text(grid(4)).splitlines()
    cloud = read(tmp_path, "\n".join(lines[:-2]) + "\n", points=300)
    assert (cloud.points, cloud.seen, cloud.lost) == (14, 14, 2)


@pytest.mark.parametrize(
    ("content", "noise", "said"),
    [
        (text(grid(3)), Noise(), "state the noise of ux, uy, uz"),
        (text(grid(3)) + text(grid(3)).split("\n", 1)[1], STATED, r"the point \(-8, -8\) mm stands twice at 1 mm"),
        ("depth_mm,x_mm,y_mm,ux_mm,uy_mm,uz_mm\n1,0,0,0,0,-1\n2,1,0,0,0,-1\n", STATED, "no point is in all 2 images"),
    ],
)
def test_what_is_no_cloud_is_refused_by_name(tmp_path, content, noise, said):
    with pytest.raises(ValueError, match=said):
        read(tmp_path, content, noise)


@pytest.mark.parametrize(
    ("header", "more", "said"),
    [
        ("depth_mm,x_mm,y_mm,ux_mm,uy_mm,uz_mm", "points = 0", "points"),
        ("depth_mm,x_mm,y_mm,ux_mm,uy_N,uz_mm", "", "uy"),
        ("depth_mm,x_mm,y_mm,ux_mm,z_mm,uz_mm", "", "no such channel.*choose"),
        ("depth_mm,x_mm,z_mm,ux_mm,uy_mm,uz_mm", "", "x_mm and y_mm"),
    ],
)
def test_a_wrong_file_or_key_is_said(marked, header, more, said):
    path = marked / "cloud.csv"
    path.write_text(header + "\n" + path.read_text().split("\n", 1)[1])
    with pytest.raises(StudyError, match=said):
        make_plan(load_study(studies.write(marked, experiments=TOP + CLOUD.format("fit") + NOISE + "\n" + more)))


def test_a_check_says_how_many_points_are_compared(marked):
    study = load_study(studies.write(marked, backend=MARKED, experiments=TOP + CLOUD.format("fit") + NOISE))
    said = "\n".join(check_lines(study, marked / "results", trust=True))
    assert "Compared are 30 of 225 points of the surface, the most informative ones" in said


# ---------------------------------------------------------------------------------------------------------- thinning


def gained(places, w, length, size, chosen) -> float:
    """log |K + N| − log |N| of some points."""
    apart = np.sqrt(((places[:, None] - places[None]) ** 2).sum(-1))
    N, K = np.exp(-apart / length), np.outer(w, w) * np.exp(-0.5 * (apart / size) ** 2)
    i = np.ix_(chosen, chosen)
    return np.linalg.slogdet((K + N)[i])[1] - np.linalg.slogdet(N[i])[1]


def test_points_that_are_kept_tell_more_than_any_drawn_by_chance():
    places = grid(13)
    moved = exact(places, 2.0)[2:]
    rng, length = np.random.default_rng(0), 2.0
    chosen = most_informative(places, moved, [SIGMA], length, 12)
    assert len(set(chosen)) == 12
    w = np.abs(moved[0]) / SIGMA
    mine = gained(places, w, length, 5.0, chosen)
    assert mine > max(gained(places, w, length, 5.0, rng.permutation(len(places))[:12]) for _ in range(200))
    assert np.array_equal(most_informative(places[:5], moved[:, :5], [SIGMA], length, 12), np.arange(5))


# --------------------------------------------------------------------------------------------------------- inference


def estimates(folder: Path, noise: Noise, n: int = 60) -> np.ndarray:
    """(ĉ − c)/sd of fits to clouds with noise that is correlated over `LENGTH`, with the covariance of `noise`."""
    box = Box(("c",), ("1",), (0.2,), (2.0,), (False,))
    z = []
    for seed in range(n):
        cloud = read(folder, text(grid(9), np.random.default_rng(seed), (2.0,), LENGTH), noise, points=81)

        def predict(X, cloud=cloud):
            axis = [("ux", "uy", "uz").index(c) for c in cloud.component]
            rows = [exact(cloud.position, 2.0, float(c[0])) for c in box.from_unit(X)]
            return np.stack([r[axis, np.arange(len(axis))] for r in rows])

        misfit = Misfit(Model(box, predict), (Data("cloud", "mm", cloud.depth, cloud.value, cloud.covariance),))
        fit = gauss_newton(misfit, np.array([0.4]))
        z.append((fit.theta[0] - C) * np.sqrt(fit.fisher[0, 0]) / 1.8)
    return np.array(z)


def test_intervals_hold_the_truth_and_white_noise_would_make_them_too_narrow(tmp_path):
    """z is standard normal: its size over 60 clouds lies within 1 ± 0.28 (three deviations of √χ²₆₀/60)."""
    right = estimates(tmp_path, STATED)
    assert abs(np.sqrt(np.mean(right**2)) - 1.0) < 0.28
    white = estimates(tmp_path, dataclasses.replace(STATED, surface_correlation=0.0))
    assert np.sqrt(np.mean(white**2)) > 1.28


@pytest.mark.parametrize(
    "search",
    [
        studies.SECTIONS["search"],
        'method = "gauss_newton"\nderivatives = "differences"',
    ],
    ids=["response_surface", "gauss_newton"],
)
def test_a_cloud_is_fitted_beside_the_force(marked, search):
    """The truth lies within 4 standard deviations, and D1 is known clearly better than by the force alone."""
    both = studies.run(marked / "a", backend=MARKED, experiments=TOP, search=search)
    (marked / "b").mkdir()
    (marked / "b" / "cloud.csv").write_text((marked / "cloud.csv").read_text())
    found = studies.run(marked / "b", backend=MARKED, experiments=TOP + CLOUD.format("fit") + FEW, search=search)
    alone, beside = ({p["parameter"]: p for p in r["identification"]["parameters"]} for r in (both, found))
    for name, true in (("mu", studies.MU), ("D1", studies.D1)):
        assert abs(np.log(beside[name]["value"] / true)) < 4.0 * beside[name]["sd_log"]
    assert beside["D1"]["sd_log"] < alone["D1"]["sd_log"] / 1.5
    rows = [d for d in found["identification"]["data"] if d["channel"] == "surface"]
    assert [(d["points"], len(d["marks"])) for d in rows] == [(90, 90)]
    (drawn,) = cloud_maps(found)
    assert drawn.role == "fit" and "<svg" in draw(found, "cloud-0")
    assert np.sqrt(np.mean(drawn.off**2)) == pytest.approx(1.0, abs=0.25)  # three deviations of 90 readings


def test_a_cloud_validates_a_model_and_refutes_a_wrong_one(marked):
    experiments = TOP + CLOUD.format("validate") + NOISE
    found = studies.run(marked, backend=MARKED, experiments=experiments)
    (row,) = found["predictions"]
    assert row["verdict"] in ("yes", "among") and row["p_value"] > 0.01 and row["points"] == 270
    (drawn,) = cloud_maps(found)
    assert drawn.role == "validate" and drawn.p_value == row["p_value"]
    missing: list[str] = []
    render(found, marked / "page", pdf=False, language="de", untranslated=missing)
    assert set(missing) <= {"compressibility, D1 = 2/K", "test"}  # words of this backend, and the command
    lines = (marked / "cloud.csv").read_text().splitlines()
    moved = [",".join([*r.split(",")[:5], repr(1.1 * float(r.split(",")[5]))]) for r in lines[1:]]
    (marked / "cloud.csv").write_text("\n".join([lines[0], *moved]) + "\n")
    (row,) = studies.run(marked, backend=MARKED, experiments=experiments)["predictions"]
    assert row["verdict"] == "no"


@pytest.mark.parametrize(
    "search",
    [
        pytest.param(studies.SECTIONS["search"], id="rs", marks=pytest.mark.verification),
        pytest.param('method = "gauss_newton"\nderivatives = "differences"', id="gn"),
    ],
)
def test_a_size_that_is_uncertain_beside_a_cloud(marked, search):
    """The sphere was one standard uncertainty larger than stated; it moves the force of this backend, no point."""
    h = np.linspace(0, 2.0, 21)[1:]
    F = indentation_backend.force(studies.MU, studies.D1, h, studies.THICKNESS, 3.1)
    rows = "".join(f"{u!r},{f!r}\n" for u, f in zip(h.tolist(), F.tolist(), strict=True))
    (marked / "top.csv").write_text("depth_mm,Fz_N\n" + rows)
    changes = {"backend": MARKED, "experiments": TOP + CLOUD.format("fit") + FEW, "search": search}
    exact_one = studies.run(marked, **changes)["identification"]["parameters"][0]
    found = studies.run(marked, **changes, uncertainty="radius = 0.1")["identification"]
    low, high = found["parameters"][0]["interval"]
    assert low < studies.MU < high
    assert not exact_one["interval"][0] < studies.MU < exact_one["interval"][1]
    assert [list(d["fitted"]["inputs"]) for d in found["data"]] == [["radius"], []]
