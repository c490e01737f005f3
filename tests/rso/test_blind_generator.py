"""The blind generator's parts that need no finite elements: chain, noise, sealing, score."""

import ast
import hashlib
import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks" / "blind"
NAMES = ("catalogue", "library", "experiment", "generate", "score")


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
        nominal = (folder / "nominal.json").read_bytes()
        seen.add((tuple(f.name for f in files), lengths, tuple(f.stat().st_mtime for f in files), nominal))
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
