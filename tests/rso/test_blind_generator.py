"""The blind generator's parts that need no finite elements: chain, noise, sealing, score."""

import ast
import hashlib
import importlib
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks" / "blind"
README = (FOLDER / "README.md").read_text().split("\n")
NAMES = ("catalogue", "library", "experiment", "flat", "generate", "score")


@pytest.fixture(scope="module")
def blind():
    """The modules of the folder, imported by path and forgotten afterwards (their names are plain)."""
    kept = {n: sys.modules.pop(n) for n in NAMES if n in sys.modules}
    sys.path.insert(0, str(FOLDER))
    modules = {n: importlib.import_module(n) for n in NAMES}
    yield type("Blind", (), modules)
    sys.path.remove(str(FOLDER))
    for n in NAMES:
        sys.modules.pop(n, None)
    sys.modules.update(kept)


@pytest.fixture(scope="module")
def round_of_cases(blind, tmp_path_factory):
    """A small round without finite elements, made by the command line."""
    out = tmp_path_factory.mktemp("round")
    rng = np.random.default_rng(3)
    plan = [blind.generate.draw_case("null", [], rng) for _ in range(2)]
    plan += [blind.generate.draw_case("single", [n], rng) for n in ("compliance", "lag", "drift", "offset_each")]
    plan += [blind.generate.draw_case("pair", ["bias", "cross_x"], rng)]
    plan += [blind.generate.draw_case("outside", [n], rng) for n in ("clipping", "swapped_file", "backlash")]
    for k, case in enumerate(plan):
        case["id"] = f"case_{k + 1:04d}"
    (out / "sealed").mkdir()
    (out / "sealed" / "plan.json").write_text(json.dumps(plan))
    command = [sys.executable, str(FOLDER / "generate.py"), "--out", str(out)]
    subprocess.run(command, check=True, capture_output=True)
    return out


def test_imports_nothing_of_the_product():
    for path in FOLDER.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(n.split(".")[0] in ("rso", "fem_backend") for n in names), path.name


def test_folders_do_not_hint(round_of_cases):
    folders = sorted(round_of_cases.glob("case_*"))
    seen = set()
    for folder in folders:
        files = sorted(folder.iterdir())
        lengths = tuple(len(f.read_text().splitlines()) for f in files)
        nominal = json.loads((folder / "nominal.json").read_text())
        assert set(nominal.pop("noise")) == {"force_N", "depth_mm", "repeat_gain", "profile_mm"}
        seen.add((tuple(f.name for f in files), lengths, tuple(f.stat().st_mtime for f in files), json.dumps(nominal)))
    assert len(folders) == 10 and len(seen) == 1


def test_hashes_are_verified(blind, round_of_cases, tmp_path):
    assert len(blind.score.read(round_of_cases, tmp_path)) == 10
    copy = tmp_path / "copy"
    subprocess.run(["cp", "-r", str(round_of_cases), str(copy)], check=True)
    victim = copy / "sealed" / "case_0003.json"
    truth = json.loads(victim.read_text())
    truth["material"]["mu"] *= 1.01
    victim.write_text(json.dumps(truth, indent=1) + "\n")
    with pytest.raises(ValueError, match="case_0003"):
        blind.score.read(copy, tmp_path)


def test_running_again_changes_nothing(round_of_cases):
    before = hashlib.sha256((round_of_cases / "hashes.txt").read_bytes()).hexdigest()
    subprocess.run([sys.executable, str(FOLDER / "generate.py"), "--out", str(round_of_cases)], check=True)
    assert hashlib.sha256((round_of_cases / "hashes.txt").read_bytes()).hexdigest() == before


def test_signal_is_zero_on_null_and_not_on_effects(round_of_cases):
    truths = [json.loads(p.read_text()) for p in sorted((round_of_cases / "sealed").glob("case_*.json"))]
    null = [t["signal"] for t in truths if t["kind"] == "null"]
    swapped = [t["signal"] for t in truths if t["effects"] and t["effects"][0]["name"] == "swapped_file"]
    assert max(null) < 0.05 and min(swapped) > 10  # exchanged point files put 0.08 N of Fx where 0.01 N is expected


def test_compliance_by_substitution(blind):
    force = lambda d: np.stack([0 * d, 0 * d, 0.06 * np.clip(d, 0, None) ** 1.5], 1)  # noqa: E731
    recorded = np.linspace(0.3, 4, 30)
    d = blind.experiment.true_depth(force, recorded, offset=0.07, compliance=0.3)
    np.testing.assert_allclose(d - 0.07 + 0.3 * force(d)[:, 2], recorded, atol=1e-9)  # 45 halvings of 6 mm


def test_lag_of_a_ramp(blind):
    t = np.linspace(0, 8, 41)
    y = blind.experiment.lagged(t, np.outer(t, [1.0, 2.0, 3.0]), 0.4)
    exact = np.outer(t - 0.4 * (1 - np.exp(-t / 0.4)), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(y, exact, atol=1e-12)  # exact for piecewise linear input


def test_coloured_noise_keeps_its_size(blind):
    rng, n = np.random.default_rng(0), 40000
    record = (np.arange(n) * 0.2, np.arange(n) * 0.1, np.zeros((n, 3)), np.zeros(n))
    noise = {"repeat_gain": 0.01, "depth_mm": 0.005, "force_N": 0.003, "rho": 0.7}
    F = blind.experiment.noisy(record, rng, noise, 0.0)[2]
    np.testing.assert_allclose(F.std(0), 0.003, rtol=0.05)  # about 14000 independent values: 0.6 %
    np.testing.assert_allclose([np.corrcoef(c[1:], c[:-1])[0, 1] for c in F.T], 0.7, atol=0.02)


def test_turned_force_leans_by_what_its_table_says(blind):
    lean = [[0.03, -0.01], [0.002, 0.0], [0.0, 0.0]]
    tables = {"20_0": {"ratio": [0.98, 0.004, 0.0], "lean": lean, "deepest": 4.0}}
    mechanics = blind.experiment.Mechanics(0.13, turned=tables)
    d = np.array([0.0, 1.0, 4.0, 4.2])
    straight = mechanics.null("20_0", d)
    F = blind.experiment.turned(mechanics, straight, "20_0", d)
    np.testing.assert_allclose(F[:, 2], straight[:, 2] * [0.98, 0.984, 0.996, 0.996], rtol=1e-12)
    change = F[1:, :2] / F[1:, 2:] - straight[1:, :2] / straight[1:, 2:]
    np.testing.assert_allclose(change, [[0.032, -0.01], [0.038, -0.01], [0.038, -0.01]], rtol=1e-9)
    np.testing.assert_array_equal(blind.experiment.turned(mechanics, straight, "top", d), straight)


def test_clopper_pearson(blind):
    low, high = blind.score.clopper_pearson(0, 60)
    assert low == 0
    np.testing.assert_allclose(high, 1 - 0.025 ** (1 / 60), rtol=1e-9)  # closed form for no hit


def answer(verdict, effect=None, probability=0.95, interval=(0.0, 1.0)):
    causes = [{"effect": effect, "probability": probability, "size": 0.5, "interval": list(interval)}] if effect else []
    return {"diagnosis": {"verdict": verdict, "causes": causes, "ambiguous_with": []}}


def test_score_of_a_perfect_a_silent_and_a_bold_answer(blind, round_of_cases, tmp_path):
    truths = [json.loads(p.read_text()) for p in sorted((round_of_cases / "sealed").glob("case_*.json"))]
    players = {"perfect": {}, "silent": {}, "bold": {}}
    for t in truths:
        right = {"null": answer("no_gap"), "outside": answer("unexplained")}.get(t["kind"])
        band = {"low": 0.9, "median": 1.0, "high": 1.1}
        mu, wrong = ({"mu": {k: f * v * t["material"]["mu"] for k, v in band.items()}} for f in (1.0, 1.2))
        found = answer("explained", (t["allowed"]["causes"] or [None])[0])
        found["diagnosis"]["parameters"] = {"before": wrong, "after": mu}
        players["perfect"][t["id"]] = right or found
        players["silent"][t["id"]] = answer("no_gap")
        players["bold"][t["id"]] = answer("explained", "friction")
    figures = {}
    for player, answers in players.items():
        folder = tmp_path / player
        folder.mkdir()
        for name, content in answers.items():
            (folder / f"{name}.json").write_text(json.dumps(content))
        figures[player] = blind.score.figures(blind.score.read(round_of_cases, folder))
        assert "failures" in blind.score.report(figures[player])
    assert figures["perfect"]["false_alarm"]["k"] == 0 and figures["perfect"]["top_1"]["rate"] == 1
    assert figures["perfect"]["outside_allowed"]["rate"] == 1 and figures["perfect"]["failures"] == []
    held = [figures["perfect"][f"mu_held_{when}"] for when in ("before", "after")]
    assert [v["rate"] for v in held] == [0, 1] and held[0]["n"] > 0
    for before, after in figures["perfect"]["mu_bias"].values():
        np.testing.assert_allclose([before, after], [0.2, 0.0], rtol=0, atol=1e-12)
    assert figures["silent"]["false_alarm"]["k"] == 0 and figures["silent"]["detection_visible"]["k"] == 0
    assert figures["bold"]["false_alarm"]["k"] == 2 and figures["bold"]["top_1"]["k"] == 0
    assert figures["bold"]["outside_confidently_wrong"]["rate"] == 1


def test_every_effect_can_be_drawn_and_answered(blind):
    rng = np.random.default_rng(1)
    for name in (*blind.catalogue.SINGLE, *blind.catalogue.OUTSIDE):
        effect = blind.catalogue.draw(name, rng)
        assert effect["model"] or effect["chain"]
        assert json.loads(json.dumps(effect)) == effect
        if name in blind.catalogue.FREE:
            assert not effect["model"]


KINDS = {  # outside kinds added since the eighth round: range of the size, and an example of their other numbers
    "screw_error": (0.005, 0.08, {"screw_pitch": 1.5, "screw_phase": 0.7}),
    "lint": (0.03, 0.5, {"lint_force": 0.004}),
    "parallel_spring": (1e-3, 6e-2, {}),
    "poroelastic": (0.01, 0.4, {"poroelastic_time": 10.0}),
    "tear": (0.005, 0.3, {"tear_depth": 4.75}),
    "cell_hysteresis": (0.003, 0.08, {}),
    "recovery": (0.02, 0.3, {"recovery_time": 100.0, "recovery_rests": [30.0 * (k + 1) for k in range(11)]}),
    "collar": (0.003, 0.3, {"collar_depth": 3.05}),
    "glue": (0.03, 0.8, {"glue_time": 10.0}),
}
OTHER = {  # ranges of the other numbers
    "screw_pitch": (0.5, 2.0),
    "screw_phase": (0.0, 2 * np.pi),
    "lint_force": (0.002, 0.02),
    "poroelastic_time": (2.0, 60.0),
    "tear_depth": (4.1, 5.2),
    "recovery_time": (60.0, 400.0),
    "recovery_rests": (20.0, 900.0),
    "collar_depth": (2.5, 4.5),
    "glue_time": (1.0, 60.0),
}
TOP = {"mp_load", "mp_cycle_10", "mp_cycle_30", "mp_cycle_100", "mp_deep"}
POINTS = {"point_2.5_2.5", "point_20_0"}
TOUCHED = {
    **dict.fromkeys(("screw_error", "lint", "glue"), TOP | POINTS | {"profile"}),
    **dict.fromkeys(("parallel_spring", "poroelastic", "collar"), TOP | POINTS),
    "tear": {"mp_deep", "point_2.5_2.5"},
    "cell_hysteresis": {"mp_cycle_10", "mp_cycle_30", "mp_cycle_100"},
    "recovery": TOP | {"point_2.5_2.5"},
}
MU, MU_D1 = 0.009, 0.13


def clean(blind, kind=None, size=0.0, **other):
    """Noise-free records {(test, repeat): (t, depth, F, true)} with one outside kind of this size."""
    chain = {kind: size, **KINDS[kind][2], **other} if kind else {}
    return {test[:2]: record for test, record in blind.experiment.clean(blind.experiment.Mechanics(MU_D1), MU, chain)}


def files(blind, folder, kind=None, size=0.0):
    """Text of all files written with one outside kind of this size and always the same noise."""
    chain = {kind: size, **KINDS[kind][2]} if kind else {}
    noise = {
        "force_N": 0.003,
        "depth_mm": 0.005,
        "repeat_gain": 0.01,
        "profile_mm": 0.05,
        "rho": 0.5,
        "jitter_mm": 0.01,
    }
    mechanics, rng = blind.experiment.Mechanics(MU_D1), np.random.default_rng(5)
    blind.experiment.write(folder, mechanics, MU, chain, rng, noise, blind.generate.NOMINAL)
    return {p.stem: p.read_text() for p in folder.glob("*.csv")}


@pytest.mark.parametrize("kind", KINDS)
def test_an_outside_kind_of_size_0_changes_nothing(blind, tmp_path, kind):
    plain = clean(blind)
    for key, record in clean(blind, kind, 0.0).items():
        assert all(np.array_equal(a, b) for a, b in zip(record, plain[key], strict=True)), key
    assert files(blind, tmp_path / "zero", kind, 0.0) == files(blind, tmp_path / "plain")


@pytest.mark.parametrize("kind", KINDS)
def test_an_outside_kind_touches_its_files_and_no_other(blind, tmp_path, kind):
    plain, found = files(blind, tmp_path / "plain"), files(blind, tmp_path / "found", kind, KINDS[kind][1])
    assert {name for name in plain if plain[name] != found[name]} == TOUCHED[kind]


@pytest.mark.parametrize("kind", KINDS)
def test_sizes_of_an_outside_kind_fill_their_range_evenly_in_the_logarithm(blind, kind):
    rng, (low, high, other) = np.random.default_rng(2), KINDS[kind]
    drawn = [blind.catalogue.draw(kind, rng) for _ in range(400)]
    place = np.log(np.array([d["size"] for d in drawn]) / low) / np.log(high / low)
    assert place.min() >= 0 and place.max() <= 1
    assert np.abs(np.sort(place) - (np.arange(400) + 0.5) / 400).max() < 0.0975  # Kolmogorov, 0.1 %: 1.95/sqrt(400)
    for name in other:
        values, (least, most) = np.array([d["chain"][name] for d in drawn]), OTHER[name]
        assert least <= values.min() < min(least + 0.03 * (most - least), 1.15 * least or 1.0)
        assert 0.97 * most < values.max() <= most
    assert set(drawn[0]["chain"]) == {kind, *other} and len(drawn[0]["truth"]) == 1 + len(other)


def test_screw_error_repeats_with_the_position_of_the_machine(blind):
    size, pitch, phase = 0.05, 1.5, 0.7
    found = clean(blind, "screw_error", size)
    for (name, _), (_, h, F, true) in found.items():
        lower = 35 * (1 - np.sqrt(8) / 3) if name == "point_20_0" else 0.0  # z of the ellipsoid at x = 20 of 60 mm
        if name == "point_2.5_2.5":
            lower = 35 * (1 - np.sqrt(1 - (2.5 / 60) ** 2 - (2.5 / 35) ** 2))
        start = 2 * np.pi * lower / pitch + phase
        error = size * (np.sin(start + 2 * np.pi * h / pitch) - np.sin(start))
        np.testing.assert_allclose(true - h, error, rtol=0, atol=1e-10)
        if name == "mp_load":
            null = blind.experiment.Mechanics(MU_D1).null("top", true) * MU
            np.testing.assert_allclose(F, null, rtol=0, atol=1e-12)
            assert abs(error[::15]).max() < 1e-12 < 0.05 < np.ptp(error)  # nothing after whole turns


def test_lint_lets_go_first_and_only_shifts_later(blind):
    size, soft, plain = 0.3, 0.004, clean(blind)
    for key, (_, h, F, true) in clean(blind, "lint", size).items():
        np.testing.assert_allclose(h - true, size * (1 - np.exp(-F[:, 2] / soft)), rtol=0, atol=1e-10)
        late = h > 2.0
        np.testing.assert_allclose(true[late], h[late] - size, rtol=0, atol=1e-6)  # parallel
        early = (h > 0) & (h < 0.35)
        assert (F[early, 2] < 0.6 * plain[key][2][early, 2]).all() and early.any()


def test_a_parallel_spring_adds_what_the_travel_asks_for(blind):
    plain = clean(blind)
    for key, (_, h, F, true) in clean(blind, "parallel_spring", 0.02).items():
        np.testing.assert_allclose(F - plain[key][2], np.outer(h, [0, 0, 0.02]), rtol=0, atol=1e-15)
        np.testing.assert_array_equal(true, plain[key][3])


def test_a_mount_that_creeps_follows_its_equation(blind):
    """z = h - d,  T dz/dt + z = c Fz: by central differences, and the way back lies below the way there."""
    c, T = 0.4, 8.0
    for _, (t, h, F, d) in clean(blind, "glue", c, glue_time=T).items():
        z = h - d
        dz = (z[2:] - z[:-2]) / (t[2:] - t[:-2])
        inside = (np.diff(t)[1:] > 0) & (d[2:] > 0.1) & (d[:-2] > 0.1)
        step = np.diff(t)[1:] / T  # error of the differences, and where the way turns
        turn = np.argmax(h) - 1
        inside[max(turn - 1, 0) : turn + 2] = False
        rest = (T * dz + z[1:-1] - c * F[1:-1, 2])[inside]
        np.testing.assert_allclose(rest, 0.0, atol=0.02 * z.max() * max(1.0, step.max()))
        if h[-1] < 1.0:
            up, down = slice(0, np.argmax(h) + 1), slice(np.argmax(h), None)
            assert np.interp(2.0, h[down][::-1], F[down, 2][::-1]) < 0.999 * np.interp(2.0, h[up], F[up, 2])


def test_overstress_of_water_takes_longer_the_deeper(blind):
    t = np.linspace(0, 30, 61)
    for depth in (1.0, 2.0, 4.0):
        tau = 8.0 * depth / 4.0
        s = blind.experiment.overstress(t, np.full(61, depth), np.outer(t, [0.0, 0.1, 1.0]), 0.3, 8.0)
        exact = 0.3 * tau * (1 - np.exp(-t / tau))  # of a ramp
        np.testing.assert_allclose(s, np.outer(exact, [0.0, 0.1, 1.0]), rtol=1e-12, atol=1e-14)


def test_poroelastic_forces_are_larger_the_faster_and_never_pull(blind):
    plain, found = clean(blind), clean(blind, "poroelastic", 0.4)
    ratio = [found[(f"mp_cycle_{v}", 0)][2][1:40, 2] / plain[(f"mp_cycle_{v}", 0)][2][1:40, 2] for v in (10, 30, 100)]
    assert (np.diff([1 + 0 * ratio[0], *ratio, 1.4 + 0 * ratio[0]], axis=0) > 0).all()  # drained < ... < undrained
    for v in (10, 30, 100):
        F, base = found[(f"mp_cycle_{v}", 0)][2], plain[(f"mp_cycle_{v}", 0)][2]
        assert (F[:, 2] >= 0).all() and (F[-10:-1, 2] < base[-10:-1, 2]).all()
    fast, base = found[("mp_cycle_100", 0)][2], plain[("mp_cycle_100", 0)][2]
    assert (fast[-8:-1, 2] == 0).any() and (base[-8:-1, 2] > 0).all()  # the sphere lifts off before the way is back


def test_a_tear_opens_at_once_and_stays(blind):
    plain, found = clean(blind), clean(blind, "tear", 0.2)
    ratio = {key: found[key][2][1:, 2] / plain[key][2][1:, 2] for key in (("mp_deep", 0), ("point_2.5_2.5", 0))}
    deep = np.where(plain[("mp_deep", 0)][1][1:] > 4.75, 0.8, 1.0)
    np.testing.assert_allclose(ratio[("mp_deep", 0)], deep, rtol=1e-12)
    np.testing.assert_allclose(ratio[("point_2.5_2.5", 0)], 1 - 0.6 * 0.2, rtol=1e-12)
    side = found[("point_2.5_2.5", 0)][2][1:] / plain[("point_2.5_2.5", 0)][2][1:]
    np.testing.assert_allclose(side, 0.88, rtol=1e-12)  # all channels alike


def test_the_loop_of_a_cell_is_closed_and_knows_no_speed(blind):
    plain, found, size = clean(blind), clean(blind, "cell_hysteresis", 0.05), 0.05
    loops = [found[(f"mp_cycle_{v}", 0)][2] - plain[(f"mp_cycle_{v}", 0)][2] for v in (10, 30, 100)]
    np.testing.assert_array_equal(loops[0], loops[1])
    np.testing.assert_array_equal(loops[0], loops[2])
    F = plain[("mp_cycle_10", 0)][2][:, 2]
    loop, peak = loops[0][:, 2], F.max()
    assert (loops[0][:, :2] == 0).all() and (loop[:41] == 0).all() and loop[-1] == 0 and (loop[41:-1] > 0).all()
    np.testing.assert_allclose(loop[41:], 4 * size * F[41:] * (1 - F[41:] / peak), rtol=0, atol=1e-14)
    np.testing.assert_allclose(loop.max(), size * peak, rtol=2e-3)  # a reading near half of the peak
    down = np.arange(81) <= 40
    double = blind.experiment.cell_loop(2 * F, down, size)
    np.testing.assert_allclose(double, 2 * blind.experiment.cell_loop(F, down, size), rtol=1e-12)  # with the peak


def test_what_has_not_recovered_is_softer_by_the_rest_before(blind):
    plain, found = clean(blind), clean(blind, "recovery", 0.3)
    for k, key in enumerate(plain):  # 11 tests in the order they are done; the rest before test k is 30 (k + 1) s
        reach = {"point_2.5_2.5": 0.6, "point_20_0": 0.0}.get(key[0], 1.0) if k else 0.0
        expected = 1 - 0.3 * reach * np.exp(-30.0 * (k + 1) / 100.0)
        np.testing.assert_allclose(found[key][2], plain[key][2] * expected, rtol=1e-12, atol=0)
    assert len(plain) == 11 and next(iter(plain)) == ("mp_load", 1)


def test_a_collar_touches_late_and_on_a_slope_earlier(blind):
    plain, found = clean(blind), clean(blind, "collar", 0.2)
    slope = {"point_20_0": 35**2 * 20 / 60**2 / (35 * np.sqrt(8) / 3)}
    z = 35 * np.sqrt(1 - (2.5 / 60) ** 2 - (2.5 / 35) ** 2)
    slope["point_2.5_2.5"] = np.hypot(35**2 * 2.5 / 60**2, 2.5) / z
    for key, (_, h, F, _) in found.items():
        touch = 3.05 - 2.0 * slope.get(key[0], 0.0)
        factor = 1 + 0.2 * np.where(h > touch, np.abs(h - touch), 0.0) ** 1.5
        np.testing.assert_allclose(F, plain[key][2] * factor[:, None], rtol=1e-9, atol=0)
        assert (factor[h < 2.6] == 1).all() and factor.max() > 1.1
    late = clean(blind, "collar", 0.2, collar_depth=4.45)
    assert [k for k in late if not np.array_equal(late[k][2], plain[k][2])] == [("mp_deep", 0)]


def names(cell):
    """Names of a table's cell, without what stands in parentheses after a blank, except a place."""
    plain = re.sub(r"(?<! at) \([^)]*\)", "", cell).strip()
    return set() if plain == "-" else set(re.split(r", (?![^(]*\))", plain))


def test_verdicts_of_outside_kinds_are_published(blind):
    rows = [[c.strip() for c in line.strip("| ").split(" | ")] for line in README if line.startswith("|")]
    published = {row[0].split(":")[0]: row[-2:] for row in rows if ":" in row[0] and len(row) in (3, 4)}
    assert set(published) == set(blind.catalogue.OUTSIDE) and set(KINDS) < set(published)
    for kind, (verdicts, causes) in blind.catalogue.OUTSIDE.items():
        assert (names(published[kind][0]), names(published[kind][1])) == (set(verdicts), set(causes)), kind
        assert {"unexplained", "partly"} <= set(verdicts)
    also = {row[0]: names(row[1]) for row in rows if len(row) == 2 and row[0] in blind.catalogue.OUTSIDE}
    assert also == {kind: set(listed) for kind, listed in blind.catalogue.LISTED.items()}


def sealed(blind, kind, size=20.0):
    """Truth of an outside case as far as verdicts go."""
    case = {"kind": "outside", "effects": [{"name": kind}]}
    return {"kind": "outside", "effects": [{"name": kind}], "allowed": blind.generate.allowed(case, size)}


def judged(blind, truth, verdict, effect, cause=None, group=()):
    """(allowed, confidently wrong) of an answer as `score.read` passes it on."""
    found = answer(verdict, effect)["diagnosis"]
    found["causes"][0].update({"cause": cause} if cause else {})
    found["ambiguous_with"] = [list(group)] if group else []
    passed = blind.score.passed(found)
    return blind.score.acceptable(truth, passed), blind.score.confidently_wrong(truth, passed)


@pytest.mark.parametrize(
    ("kind", "effect", "cause"),
    [
        ("temperature", "ageing", None),
        ("temperature", "ageing", "drift"),
        ("wrong_point", "offset_x", None),
        ("wrong_point", "offset_x at (20, 0)", "offset_x"),
        ("rocking", "compliance at (20, 0)", "compliance"),
        ("rocking", "compliance", None),
        ("set", "permanent_set", "offset"),
        ("backlash", "backlash", None),
        ("depth_scale", "depth_scale", None),
        ("nonlinear_cell", "nonlinearity", None),
        ("glue", "creep", "compliance"),
    ],
)
def test_names_that_are_in_the_catalogue_by_now_count_alone(blind, kind, effect, cause):
    truth = sealed(blind, kind)
    for verdict in ("explained", "measurement"):
        assert judged(blind, truth, verdict, effect, cause) == (True, False)
    assert judged(blind, truth, "ambiguous", effect, cause, [effect, "bowl"]) == (True, False)
    assert judged(blind, truth, "explained", "friction") == (False, True)
    before = {**truth, "allowed": {"verdicts": ["unexplained", "partly"], "causes": []}}  # sealed in an earlier round
    assert judged(blind, before, "explained", effect, cause) == (False, True)
    assert judged(blind, before, "measurement", effect, cause) == (False, False)


def test_a_name_with_another_place_does_not_count(blind):
    assert judged(blind, sealed(blind, "rocking"), "explained", "compliance at (2.5, 2.5)", "compliance") == (
        False,
        True,
    )
    assert not judged(blind, sealed(blind, "set"), "measurement", "offset")[
        0
    ]  # measurement is for the listed name only
    assert not judged(blind, sealed(blind, "temperature"), "measurement", "gain")[0]  # as in the rounds before
    assert judged(blind, sealed(blind, "clipping"), "measurement", "gain")[0]


def test_figures_without_the_kinds_a_catalogue_holds(blind, round_of_cases, tmp_path):
    pairs = blind.score.read(round_of_cases, tmp_path)
    by = {
        "backlash": ("explained", "backlash"),
        "clipping": ("explained", "gain"),
        "swapped_file": ("partly", "tilt_x"),
    }
    told = [(t, by[t["effects"][0]["name"]]) for t, _ in pairs if t["kind"] == "outside"]
    told = [(t, blind.score.passed(answer(*words)["diagnosis"])) for t, words in told]
    figures = blind.score.figures(told)
    assert [(figures[k]["k"], figures[k]["n"]) for k in ("outside_allowed", "unlisted_allowed")] == [(2, 3), (1, 2)]
    wrong = [figures[f"{k}_confidently_wrong"] for k in ("outside", "unlisted")]
    assert [(w["k"], w["n"]) for w in wrong] == [(1, 3), (1, 2)]
    for t, _ in told:
        t["allowed"].pop("listed")  # as sealed in earlier rounds: nothing is in a catalogue
    figures = blind.score.figures(told)
    assert figures["unlisted_allowed"] == figures["outside_allowed"]


def test_every_case_has_its_own_noise_and_states_what_a_data_sheet_would(blind, tmp_path, monkeypatch):
    monkeypatch.setattr(blind.experiment, "write", lambda *a: written.append(a[5:7]) or [])
    monkeypatch.setattr(blind.experiment, "signal", lambda *_: (0.0, []))
    written, rng = [], np.random.default_rng(0)
    (tmp_path / "sealed").mkdir()
    for k in range(30):
        blind.generate.make({**blind.generate.draw_case("null", [], rng), "id": f"case_{k:04d}"}, tmp_path)
    for noise, nominal in written:
        stated = nominal["noise"]
        assert "jitter_mm" not in stated and set(stated) == set(noise) - {"jitter_mm", "rho"}
        assert all(abs(stated[k] / noise[k] - 1.0) < 0.34 for k in stated)  # one digit: 1.5 becomes 2 at worst
    for name, (low, high, _) in blind.generate.NOISE.items():
        drawn = np.log([noise[name] for noise, _ in written])
        assert drawn.min() >= np.log(low) and drawn.max() <= np.log(high)
        assert np.ptp(drawn) > 0.5 * np.log(high / low)  # 30 uniform draws span less in fewer than one of a million
