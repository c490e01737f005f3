"""Files that settings name: found from anywhere, known by their contents, kept in results as they were written."""

from __future__ import annotations

import sample_studies as studies
from indentation_backend import BACKEND

from rso.contract import Case, Programme, run_key
from rso.contract.plain_data import by_contents
from rso.study.loader import load_study
from rso.study.settings_files import named_files, with_absolute_paths, with_relative_paths


def test_a_path_beside_the_study_is_found_from_anywhere(tmp_path):
    (tmp_path / "scans").mkdir()
    (tmp_path / "scans" / "organ.stl").write_text("solid")
    settings = {"body": {"file": "scans/organ.stl", "held": {"file": "gone.stl"}}, "file": 3, "depth": 1.0}
    found = with_absolute_paths(settings, tmp_path)
    assert found["body"]["file"] == str(tmp_path / "scans" / "organ.stl")
    assert found["body"]["held"] == {"file": "gone.stl"}  # whoever reads it says that there is none
    assert (found["file"], found["depth"]) == (3, 1.0)
    assert with_relative_paths(found, tmp_path) == settings
    assert named_files(found) == [found["body"]["file"], "gone.stl"]


def test_a_study_names_files_from_its_own_folder(tmp_path, monkeypatch):
    folder = tmp_path / "study"
    studies.write(folder, **{"backend.settings": f"thickness = {studies.THICKNESS}\nbody = {{ file = 'organ.stl' }}"})
    (folder / "organ.stl").write_text("solid")
    monkeypatch.chdir(tmp_path)
    study = load_study(folder)
    assert study.settings_of("top")["body"] == {"file": str(folder / "organ.stl")}
    assert folder / "organ.stl" in study.inputs()
    assert study.written(study.backend.settings)["body"] == {"file": "organ.stl"}


def test_a_file_with_its_hash_is_known_by_that_alone():
    def key(**body):
        return run_key(BACKEND, {}, Case("a", Programme.ramp((1.0,)), {"body": body}))

    assert key(file="/a/x.stl", sha256="1") == key(file="/b/y.stl", sha256="1") == key(sha256="1")
    assert key(file="/a/x.stl", sha256="1") != key(file="/a/x.stl", sha256="2")
    assert key(file="/a/x.stl") != key(file="/b/y.stl")  # nothing says that they hold the same
    assert by_contents({"a": [{"file": "x", "sha256": "1", "b": {"file": "y"}}]}) == {
        "a": [{"sha256": "1", "b": {"file": "y"}}]
    }
