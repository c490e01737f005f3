"""Results as files for others, runs of others as simulations of a study, the schema of a study file."""

import json
import re
import tomllib
from pathlib import Path

import hertz_program
import numpy as np
import pandas as pd
import pytest
from test_decks import MU, study

import rso
from rso.cli import main

ROOT = Path(__file__).parents[2]


def spring(travel, mu):
    return hertz_program.force(mu, travel)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A finished study with a model of this process, in a folder of its own."""
    folder = tmp_path_factory.mktemp("made")
    text = (study(folder / "study") / "study.toml").read_text()
    start, end = text.index("[backend]"), text.index("[parameters]")
    text = (
        text[:start]
        + '[backend]\nuse = "spring_model:MODEL"\n'
        + text[end:].replace('D1 = { value = "1 1/MPa" }\n', "")
    )
    (folder / "study" / "study.toml").write_text(text)
    model = rso.model(parameters={"mu": (1e-4, 1.0, "MPa")})(spring)
    workspace = rso.load(folder / "study", backend=model)
    workspace.run()
    return workspace


def test_tables_are_those_of_the_results(made, tmp_path):
    files = made.export(tmp_path / "out", "csv")
    assert {f.name for f in files} >= {"parameters.csv", "candidates.csv", "runs.csv", "curves.csv", "posterior.csv"}
    found = pd.read_csv(tmp_path / "out" / "parameters.csv")
    assert found["parameter"].tolist() == ["mu"] and found["value"][0] == pytest.approx(MU, rel=2e-3)
    curves = pd.read_csv(tmp_path / "out" / "curves.csv")
    pd.testing.assert_frame_equal(curves, made.result.curves, check_dtype=False, rtol=1e-12)


def test_draws_of_the_posterior_agree_with_its_interval(made):
    draws = pd.read_csv(made.folder / "posterior.csv")["mu"]
    row = made.result.parameters.loc["mu"]
    low, high = draws.quantile([0.05, 0.95])
    width = row["high"] - row["low"]
    assert abs(low - row["low"]) < 0.15 * width and abs(high - row["high"]) < 0.15 * width  # as the product itself asks


def test_arviz_finds_groups_variables_and_coordinates(made, tmp_path):
    """The layout of `arviz.from_json`: groups of name → nested lists, with dims and coords that fit."""
    (file,) = made.export(tmp_path, "arviz")
    data = json.loads(file.read_text())
    mu = np.array(data["posterior"]["mu"])
    assert mu.ndim == 2 and mu.shape[0] == 1 and mu.shape[1] > 300
    for name, values in data["observed_data"].items():
        assert [len(data["coords"][d]) for d in data["dims"][name]] == [len(values)]
    assert data["observed_data"]["top Fz"][-1] == pytest.approx(hertz_program.force(MU, 2.0), rel=1e-8)


def test_formats_are_listed_and_others_refused(made, tmp_path):
    known = "did you mean 'csv'? choose from arviz, bibtex, csv, figures, parquet"
    with pytest.raises(ValueError, match=re.escape(f"format 'cvs': {known}")):
        made.export(tmp_path, "cvs")
    assert not list(tmp_path.iterdir())


def test_parquet_says_what_it_needs(made, tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ValueError, match="parquet needs pyarrow"):
        made.export(tmp_path, "parquet")


def test_a_command_that_has_nothing_to_write_says_so(tmp_path, capsys):
    folder = study(tmp_path / "study")
    assert main(["export", str(folder)]) == 0
    assert "csv: tables of parameters" in capsys.readouterr().out
    assert main(["export", str(folder), "--csv"]) == 2
    assert "there are no results; rso run" in capsys.readouterr().err
    assert main(["export", str(folder), "febio", "--csv"]) == 2
    assert "format 'febio': choose from arviz, bibtex, csv, figures, parquet" in capsys.readouterr().err


def table(mus, travels, unit=1e3):
    rows = [(1e3 * m, u, 1e3 * hertz_program.force(m, u)) for m in mus for u in travels]
    return pd.DataFrame(rows, columns=["mu [kPa]", "travel", "Fz [mN]"])


MUS, TRAVELS = (0.006, 0.009, 0.013, 0.017, 0.02), np.linspace(0.0, 2.0, 81)


def test_runs_of_others_are_a_study_without_simulations(tmp_path, capsys):
    """A table of five curves is its whole design; its program is never called before the candidates are verified."""
    folder = study(tmp_path / "study")
    text = (folder / "study.toml").read_text()
    doe = '[doe]\nkind = "file"\nfile = "points.csv"\nreduce = false\nheld_out = 0'
    (folder / "study.toml").write_text(text.replace("[doe]\nruns = 5\nheld_out = 1", doe))
    (folder / "points.csv").write_text("mu\n" + "\n".join(map(str, MUS)) + "\n")
    table(MUS, TRAVELS).to_csv(folder / "runs.csv", index=False)
    assert main(["import", str(folder), str(folder / "runs.csv")]) == 0
    assert "5 simulations are stored" in capsys.readouterr().out
    assert main(["run", str(folder), "--jobs", "1"]) == 0
    found = json.loads((folder / "results" / "results.json").read_text())
    assert found["counts"]["from_store"] == 5
    (candidate,) = found["searches"][0]["candidates"]
    assert candidate["verified"] and candidate["values"]["mu"] == pytest.approx(MU, rel=5e-3)


@pytest.mark.parametrize(("change", "words"), [
    (lambda t: t.drop(columns="travel"), "column 'travel' is missing"),
    (lambda t: t.drop(columns="mu [kPa]"), "column 'mu' is missing"),
    (lambda t: t.rename(columns={"mu [kPa]": "mu [mm]"}), "column 'mu [mm]': 'mm' is not a unit of the kind 'MPa'"),
    (lambda t: t[t["travel"] < 1.5], "but 0.25 to 2 mm are asked for"),
    (lambda t: pd.concat([t, t]), "a travel stands there twice"),
    (lambda t: t.assign(**{"Fz [mN]": ["x", *t["Fz [mN]"][1:]]}), "column 'Fz [mN]', row 1: 'x' is no number"),
])  # fmt: skip
def test_a_table_that_is_none_is_refused_and_nothing_stored(tmp_path, change, words):
    workspace = rso.load(study(tmp_path / "study"))
    with pytest.raises(ValueError, match=re.escape(words)):
        workspace.import_runs(change(table(MUS, TRAVELS)))
    assert not (workspace.folder / "runs.sqlite").exists()


def test_what_lies_between_rows_of_a_table_states_its_error(tmp_path):
    workspace = rso.load(study(tmp_path / "study"))
    assert workspace.import_runs(table((0.01,), np.linspace(0.0, 2.0, 7))) == 1
    from rso.evaluation.store import RunStore

    with RunStore(workspace.folder, read_only=True) as store:
        (row,) = store.rows()
        answer = store.get(row.key).response
    truth = np.array([hertz_program.force(0.01, u) for u in answer.channels["travel"]])
    assert np.all(np.abs(answer.channels["Fz"] - truth) <= answer.error["Fz"] + 1e-9)


def test_the_schema_of_a_study_file_accepts_the_shipped_ones(capsys):
    """By hand, as far as an editor goes: known keys, required ones, and closed tables."""
    assert main(["keys", "--schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["$schema"].endswith("2020-12/schema") and schema["additionalProperties"] is False
    for file in sorted((ROOT / "studies").glob("*/study.toml")):
        data = tomllib.loads(file.read_text("utf-8"))
        assert set(data) <= set(schema["properties"]) and set(schema["required"]) <= set(data), file
        backend = schema["$defs"][schema["properties"]["backend"]["$ref"].rsplit("/", 1)[1]]
        assert set(data["backend"]) <= set(backend["properties"]), file
