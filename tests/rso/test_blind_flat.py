"""The blind generator's slab and puck, and what several folders of a round need: no finite elements are computed."""

import hashlib
import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks" / "blind"
NAMES = ("catalogue", "library", "experiment", "flat", "generate", "score", "order")


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
def folder(blind, tmp_path_factory):
    """A round on pucks without finite elements, made by the command line."""
    out = tmp_path_factory.mktemp("pucks")
    rng = np.random.default_rng(3)
    names = {"null": [[], []], "single": [["compliance"], ["drift"]], "outside": [["tear"], ["glue"]]}
    plan = [blind.generate.draw_case(kind, n, rng, "puck") for kind, each in names.items() for n in each]
    for k, case in enumerate(plan):
        case["id"] = f"case_{k + 1:04d}"
    (out / "sealed").mkdir()
    (out / "sealed" / "plan.json").write_text(json.dumps(plan))
    subprocess.run([sys.executable, str(FOLDER / "generate.py"), "--out", str(out)], check=True, capture_output=True)
    return out


@pytest.mark.parametrize("body", ["slab", "puck"])
def test_unmodified_force_starts_as_hertz_and_stiffens_as_a_thin_body(blind, body):
    muD1 = 0.01  # nu 0.495
    d = np.array([1e-4, 0.2, 0.5, 1.0])
    F = blind.flat.null(body, muD1, d)
    hertz = 4 / 3 * 2 * 1.495 / (1 - 0.495**2) * np.sqrt(3.0) * d**1.5  # E = 2 (1 + nu), R = 3 mm
    np.testing.assert_allclose(F[0], hertz[0], rtol=0.01)
    height = {"slab": 6.0, "puck": 8.0}[body]
    x = np.sqrt(3.0 * d) / height
    thin = 1 + 1.133 * x + 1.283 * x**2 + 0.769 * x**3 + 0.0975 * x**4  # Dimitriadis et al. (2002) eq. 13, nu 1/2
    assert (F[1:] > hertz[1:]).all()
    if body == "slab":  # the formula is linear, of an incompressible layer
        np.testing.assert_allclose(F[1:3] / hertz[1:3], thin[1:3], rtol=0.06)


@pytest.mark.parametrize("body", ["slab", "puck"])
def test_force_falls_with_compressibility(blind, body):
    d = np.linspace(0.1, 2.2, 12)
    F = np.array([blind.flat.null(body, v, d) for v in np.geomspace(0.01, 1.3, 9)])
    assert (np.diff(F, axis=0) < 0).all() and (np.diff(F, axis=1) > 0).all()


def test_every_effect_of_a_flat_body_can_be_drawn_and_answered(blind):
    rng = np.random.default_rng(1)
    answers = blind.catalogue.ANSWERS | blind.flat.ANSWERS
    for body in blind.flat.BODIES:
        for name in (*blind.flat.single(body), *blind.flat.outside()):
            effect = blind.flat.draw(name, rng, body)
            assert effect["model"] or effect["chain"]
            assert json.loads(json.dumps(effect)) == effect
        assert set(blind.flat.single(body)) <= set(answers)
        blobs = [blind.flat.draw("cavity", rng, body)["model"] for _ in range(200)]
        height = {"slab": 6.0, "puck": 8.0}[body]
        ends = np.array(
            [[v["blob_centre"][2] - v["blob_radius"], v["blob_centre"][2] + v["blob_radius"]] for v in blobs]
        )
        assert ends.min() > 0.3 and ends.max() < height - 0.6  # within the body


def test_what_happens_at_a_depth_lies_within_the_plan(blind):
    rng = np.random.default_rng(1)
    for name, low, high in (("tear", 1.5, 2.2), ("collar", 0.9, 2.2)):
        for _ in range(50):
            effect = blind.flat.draw(name, rng, "slab")
            assert low < effect["chain"][f"{name}_depth"] < high
            assert effect["truth"]["depth_mm"] == effect["chain"][f"{name}_depth"]


def test_a_tear_and_a_set_know_the_depths_of_this_plan(blind):
    mechanics, mu = blind.flat.Mechanics("slab", 0.13), 0.009
    plain = {r[0][:2]: r[1] for r in blind.flat.clean(mechanics, mu, {})}
    torn = {r[0][:2]: r[1] for r in blind.flat.clean(mechanics, mu, {"tear": 0.2, "tear_depth": 1.8})}
    for key, (_, h, F, true) in torn.items():
        share = np.where((true > 1.8) & (key[0] == "mp_deep"), 0.8, 1.0)
        np.testing.assert_allclose(F, plain[key][2] * share[:, None], rtol=1e-12)
        assert h.max() == pytest.approx(2.2 if key[0] == "mp_deep" else 1.5, abs=0.02)
    found = {r[0][:2]: r[1] for r in blind.flat.clean(mechanics, mu, {"set": 0.1})}
    _, h, _, true = found["mp_load", 2]
    np.testing.assert_allclose(h - true, 0.1 * 1.5, rtol=0, atol=1e-9)  # of the deepest travel before


def test_folders_of_flat_bodies_do_not_hint(folder):
    seen = set()
    for case in sorted(folder.glob("case_*")):
        files = sorted(case.iterdir())
        nominal = json.loads((case / "nominal.json").read_text())
        nominal.pop("noise")
        lengths = tuple(len(f.read_text().splitlines()) for f in files if f.suffix == ".csv")
        seen.add((tuple(f.name for f in files), lengths, json.dumps(nominal)))
    assert len(seen) == 1


def test_an_order_is_in_proportion_in_every_prefix(blind, folder):
    rng = np.random.default_rng(0)
    plan = [{"id": f"n{k}", "kind": "null", "effects": []} for k in range(30)]
    chain = {"name": "lag", "model": {}, "chain": {"lag": 0.1}}
    plan += [{"id": f"s{k}", "kind": "single", "effects": [chain]} for k in range(90)]
    names = [name for _, name in sorted(blind.order.spread(plan, rng))]
    assert sorted(names) == sorted(c["id"] for c in plan)
    nulls = np.cumsum([n.startswith("n") for n in names])
    assert np.abs(nulls - 0.25 * np.arange(1, 121)).max() < 2.5
    out = folder / "order.txt"
    command = [sys.executable, str(FOLDER / "order.py"), str(folder), "--out", str(out)]
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout == ""
    assert len(out.read_text().splitlines()) == 6


def test_folders_count_together_and_the_rival_beside(blind, folder, tmp_path):
    truths = {p.stem: json.loads(p.read_text()) for p in (folder / "sealed").glob("case_*.json")}
    answers = tmp_path / "answers"
    answers.mkdir()
    for name, truth in truths.items():
        mine = {"verdict": "no_gap", "causes": [], "ambiguous_with": []}
        said = {"gap": truth["kind"] != "null", "best": "drift", "named": ["drift"]}
        if truth["kind"] == "outside":
            said = {"gap": True, "best": "drift", "named": ["drift", "lag"]}
        (answers / f"{name}.json").write_text(json.dumps({"diagnosis": mine, "rival": said}))
    pairs = blind.score.together([folder, folder], [answers, answers])
    assert len({t["id"] for t, _ in pairs}) == 12 and max(t["id"] for t, _ in pairs) == "case_1006"
    rival = blind.score.figures([(t, blind.score.of_rival(d)) for t, d in pairs])
    assert rival["false_alarm"]["k"] == 0 and rival["false_alarm"]["n"] == 4
    wrong = [t for t, _ in pairs if t["effects"] and t["effects"][0]["name"] == "compliance"]
    assert rival["wrong_and_sure"]["k"] == len(wrong) == 2  # one name is sure, two are a set
    own = blind.score.figures(pairs)
    assert own["wrong_and_sure"]["k"] == 0 and own["outside_allowed"]["k"] == 2 * sum(
        "no_gap" in t["allowed"]["verdicts"] for t in truths.values() if t["kind"] == "outside"
    )


def test_hashes_are_those_of_the_truths(folder):
    for line in (folder / "hashes.txt").read_text().splitlines():
        name, digest = line.split()
        assert hashlib.sha256((folder / "sealed" / f"{name}.json").read_bytes()).hexdigest() == digest
