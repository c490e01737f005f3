"""The packages as they are handed out: wheel and sdist are built, and a study runs from the wheel alone."""

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.verification


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Wheel and sdist, built with what is installed: nothing is fetched."""
    pytest.importorskip("build")
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return next(folder.glob("*.whl")), next(folder.glob("*.tar.gz"))


def test_the_packages_hold_what_they_need_and_no_results(built):
    wheel, sdist = built
    inside = set(zipfile.ZipFile(wheel).namelist())
    with tarfile.open(sdist) as packed:
        source = {name.partition("/")[2] for name in packed.getnames()}
    assert {"rso/py.typed", "fem_backend/py.typed", "rso/report/layout/page.html.j2"} <= inside
    assert "rso/examples/gel_slab/measured/thin.csv" in inside
    assert {"pyproject.toml", "LICENSE", "CITATION.cff", "rso/__init__.py", "docs/index.md"} <= source
    assert not any("/results/" in name or name.endswith((".sqlite", ".pyc")) for name in inside | source)
    assert wheel.stat().st_size < 3e6 and sdist.stat().st_size < 12e6
    meta = next(name for name in inside if name.endswith(".dist-info/METADATA"))
    text = zipfile.ZipFile(wheel).read(meta).decode("utf-8")
    assert "Author: the rso authors" in text and "Classifier: Typing :: Typed" in text


def test_a_study_runs_from_the_wheel(built, tmp_path):
    """In a folder that holds nothing of the repository; the libraries are those that are installed."""
    place, here = tmp_path / "site", tmp_path / "here"
    zipfile.ZipFile(built[0]).extractall(place)
    here.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(place), "OMP_NUM_THREADS": "1"}

    def called(*words: str) -> str:
        command = [sys.executable, "-c", "import sys; from rso.cli import main; sys.exit(main())", *words]
        done = subprocess.run(command, cwd=here, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    assert str(place) in called("doctor", "--fast")
    assert "gel_slab" in called("example")
    called("example", "gel_slab")
    study = here / "gel_slab/study.toml"
    quick = '\n[search]\nmethod = "gauss_newton"\n[report]\npdf = false\n'
    study.write_text(study.read_text("utf-8").replace('"standard"', '"coarse"') + quick, "utf-8")
    assert "✓ μ" in called("run", "gel_slab", "--jobs", "1")
    assert (here / "gel_slab/results/report.html").is_file()
