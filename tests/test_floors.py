"""The rooms of the house in order, and the modules within each: imports lead downwards only."""

import ast
import functools
import importlib.util
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("rso", "fem_backend")
# For every folder, from the lowest layer up: a module imports only from lines written before its own, and from its own
# line nothing.  `*` stands for the members of an open set, which know nothing of each other.
# `__init__` is the face of a folder: what it shows lies below it, what uses it above.
LAYERS = {
    "fem_backend": (
        "compiled",
        "closed_forms geometry kinematics members",
        "contact laws meshing",
        "indenters materials remeshing specimens supports",
        "post solver",
        "simulation",
        "accuracy adapter export",
        "backend homogeneous",
        "output",
        "__main__",
    ),
    "fem_backend.accuracy": (
        "calibration two_grid warm_starts",
        "error_estimate",
        "admissible_depth",
    ),
    "fem_backend.adapter": (
        "command_line cost_model deformed derived model_hierarchy new_study priors programmes sketch stated_sizes",
        "formulas",
    ),
    "fem_backend.closed_forms": (
        "adhesion half_space homogeneous layer",
        "approximations",
        "formulas",
        "__init__",
    ),
    "fem_backend.contact": (
        "bonded pointwise self_contact",
        "tractions",
        "rings",
    ),
    "fem_backend.export": (
        "__init__",
        "material_cards",
        "solid_model",
        "abaqus febio",
        "files",
    ),
    "fem_backend.indenters": (
        "indenter meridian spherical_patch",
        "revolution",
        "*",
        "__init__",
    ),
    "fem_backend.kinematics": (
        "numbering voigt",
        "axisymmetric tetrahedra",
        "bodies pore_pressure",
    ),
    "fem_backend.laws": (
        "fibre law mullins prony",
        "admissible material",
        "*",
        "__init__",
    ),
    "fem_backend.materials": (
        "meridian_zones permeability regions",
        "stress",
        "response zones",
    ),
    "fem_backend.meshing": (
        "closed_surface mesh nearest_facets prestretched surface_files",
        "mapped meridian placing smooth_surface surface templates",
        "grids recipes refined remeshed tetwild",
        "scans",
        "__init__",
    ),
    "fem_backend.remeshing": (
        "location tetrahedra triangulation",
        "section",
    ),
    "fem_backend.post": (
        "fields pictures pressure probes vtu",
        "__init__",
    ),
    "fem_backend.simulation": (
        "experiment knobs schedule",
        "contact_elements symmetry",
        "assembly",
        "initial_state",
        "outputs pore_flow rezoning",
        "derivatives",
        "indentation",
        "controlled",
    ),
    "fem_backend.solver": (
        "direct",
        "condensation krylov",
        "newton",
        "jumps mixed_newton modified_newton rigid_motions",
        "load_steps",
        "biphasic history_steps",
        "controlled_steps",
    ),
    "fem_backend.specimens": (
        "own_laws",
        "layers specimen",
        "flat in_space",
        "ellipsoidal",
        "*",
        "__init__",
    ),
    "fem_backend.supports": (
        "holding support",
        "walls",
        "*",
        "__init__",
    ),
    "rso": (
        "__init__ contract doe norms result_types",
        "benchmarks core",
        "data emulation evaluation",
        "store",
        "inference optimise study",
        "optimal_design",
        "calibration",
        "discrepancy model_selection objectives population",
        "next_experiment report",
        "api",
        "cli",
        "__main__",
    ),
    "rso.api": (
        "executors models run_result",
        "exporting importing",
        "workspace",
        "pareto shortcuts specimens",
        "__init__",
    ),
    "rso.calibration": (
        "cost_model exit_codes plan result_files unstated_errors",
        "formula_comparison input_sides range_ends readings required_runs stages stated_settings stored_runs",
        "assumptions deformed_body finished_runs held_out joined_runs sensitivity_stage uncertain_inputs",
        "search_stage",
        "confirmed_optimum predictive_check range_extension",
        "identification_stage results search_results",
        "gauss_newton",
        "pipeline",
    ),
    "rso.calibration.gauss_newton": (
        "iteration",
        "descent_results",
    ),
    "rso.cli": (
        "output text_sketch",
        "answer example",
        "checking progress status",
        "compare doctor objectives pages specimens",
        "commands",
        "arguments",
        "__init__",
        "__main__",
    ),
    "rso.contract": (
        "parameters plain_data",
        "segments",
        "cases responses",
        "backend capabilities",
        "keys",
        "__init__",
    ),
    "rso.core": (
        "correlation curves default_backend disk distributions inline_toml polynomial_degree power_law"
        " printable similarity symbols units",
        "digits plain_results quantities",
    ),
    "rso.data": (
        "contact_point instrument scatter usual_errors variance_components",
        "curve_shape drift measured_curve preload",
        "force_holds plausibility",
        "branches",
        "files",
        "clouds holds loading_rate outliers",
        "repeats",
        "creep",
        "__init__",
    ),
    "rso.data.files": (
        "header_words rows",
        "header_aliases",
        "cantilever",
        "columns",
        "commented_header machine_lines whitespace_tables workbook",
        "lines tables tables_beside",
        "cells",
        "reading",
    ),
    "rso.discrepancy": (
        "library parameters",
        "detectors",
        "evidence",
        "base_model diagnosis proposals wording",
        "next_test rerun",
        "diagnosis_results",
        "__init__",
        "study_diagnosis",
        "blind",
    ),
    "rso.discrepancy.detectors": (
        "periodic sensor steps",
        "autocorrelation",
        "jumps",
    ),
    "rso.discrepancy.evidence": (
        "settings",
        "gaussian_mixture noise",
        "hypotheses localisation shrinkage",
        "model_form_tolerance",
        "attribution",
        "any_network cross_validation detectable marginal_ranges residual_test",
        "verdict",
        "checks",
    ),
    "rso.discrepancy.library": (
        "effects test_plan",
        "interpolation",
        "simulations",
        "planning relaxation responses",
        "tables",
        "prediction",
    ),
    "rso.doe": (
        "box constraints sampler sequences",
        "farthest space",
        "samplers",
        "registry",
        "__init__",
    ),
    "rso.doe.samplers": ("*",),
    "rso.emulation": (
        "common convex_hull feasibility kernels saving scores sensitivity",
        "kriging_likelihood polynomial",
        "kriging",
        "model_choice",
        "whole_curve",
        "multi_output",
        "__init__",
        "emulator",
        "hermite",
    ),
    "rso.evaluation": (
        "artefact_files executor_loop fingerprints guard guarded_process joint store",
        "decks",
        "adapters",
        "pool",
        "cluster dispatch",
        "evaluator slurm",
        "machines",
        "__init__",
    ),
    "rso.evaluation.decks": (
        "readers templates",
        "backend",
        "__init__",
    ),
    "rso.inference": (
        "error_surface likelihood random_effects rules",
        "autocorrelated_residuals error_model least_squares models posterior_grid tangents",
        "curve_metric gauss_newton intervals output_derivatives",
        "posterior_sampling sloppy_directions verdict",
        "identifiability",
        "derived fitted_errors predictive_test usual_errors",
        "input_effects systematic_residuals",
        "__init__",
    ),
    "rso.model_selection": (
        "evidence goodness_of_fit",
        "selection",
        "__init__",
        "candidate_models",
        "simulations",
        "held_out",
        "study_ladder",
        "ladder_results",
    ),
    "rso.next_experiment": (
        "experiments",
        "study_design",
        "design_results",
    ),
    "rso.optimal_design": (
        "expected_information ranking separation",
        "gains",
        "__init__",
    ),
    "rso.optimise": (
        "basins targets",
        "nsga2",
        "acceptable mixed",
        "candidates",
        "__init__",
        "verification",
    ),
    "rso.objectives": (
        "__init__",
        "plan surfaces",
        "front runs sensitivity",
        "solving",
        "results",
        "pipeline",
    ),
    "rso.population": (
        "__init__ plans summary",
        "running",
    ),
    "rso.report": (
        "layout",
        "reading",
        "language",
        "canvas exact_sizes notes",
        "sketch",
        "discrepancy model_selection pareto population",
        "calibration optimal_design",
        "picture_files terminal",
        "__init__",
    ),
    "rso.report.language": (
        "catalogue own_words",
        "document figure",
        "pages",
        "__init__",
    ),
    "rso.report.calibration": (
        "cloud_maps derived errors",
        "background closed_forms deformed displacements drawn_runs gap gauss_newton hold_panels inputs",
        "identification influence maps range_extension turning use",
        "predictive_check responses",
        "predictions",
        "verdict",
        "figures numbers",
        "report",
    ),
    "rso.report.discrepancy": (
        "reading",
        "background maps",
        "signatures",
        "figures",
        "reach shrinkage",
        "report",
    ),
    "rso.report.layout": (
        "document",
        "digits page",
        "byline",
    ),
    "rso.report.model_selection": (
        "figures",
        "report",
    ),
    "rso.report.optimal_design": ("report",),
    "rso.report.pareto": (
        "__init__ reading",
        "figures",
        "report",
    ),
    "rso.report.population": (
        "figures",
        "report",
    ),
    "rso.result_types": (
        "keys",
        "deformed_file diagnosis_file ladder_file learnt next_file specimens_file stated",
        "objectives_file searched",
        "identified",
        "run_file",
        "__init__",
        "reference",
    ),
    "rso.study": (
        "base_table confusable_text dimensions fields line_numbers settings_files",
        "columns_table deck_table errors noise_table objectives_table search_table",
        "analysis_tables laboratory_nominal specimens_table toml_text",
        "schema",
        "input_sizes keys loader resolve sources",
        "cases specimens",
        "holds laboratory_folder",
        "creep new_study",
    ),
}
DEEPEST = 8  # layers within a room, its face not counted; the packages themselves are streets of rooms
SEAM = {
    "members",
    "adapter.deformed",
    "adapter.derived",
    "simulation.knobs",
    "simulation.experiment",
    "adapter.formulas",
    "adapter.model_hierarchy",
    "adapter.new_study",
    "adapter.programmes",
    "adapter.sketch",
    "backend",
    "export.files",
    "export.solid_model",
    "homogeneous",
    "__main__",
}
OPEN = {"indenters", "laws", "specimens", "supports"}  # every file of these may import rso.contract


def imports(source: str, module: str, face: bool = False) -> Iterator[str]:
    """Dotted names of everything imported from the two packages, anywhere in the source of a module (or of a face)."""
    folder = module.split(".") if face else module.split(".")[:-1]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            up = folder[: len(folder) - node.level + 1] if node.level else []
            base = ".".join(filter(None, [*up, node.module or ""]))
            names = [f"{base}.{alias.name}" for alias in node.names]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] in PACKAGES)


def step_of(folder: str, name: str) -> tuple[str, int]:
    """Which item of a folder a dotted name belongs to, and in which of its layers that is."""
    item = name.removeprefix(folder).strip(".").split(".")[0]
    for k, line in enumerate(LAYERS[folder]):
        if item in line.split():
            return item, k
    members = next((k for k, line in enumerate(LAYERS[folder]) if line == "*"), -1)
    if members >= 0 and any(f"{folder}.{item}" == module for module, _, _ in modules()):
        return item, members
    lowest = next((k for k, line in enumerate(LAYERS[folder]) if "__init__" in line.split()), -1)
    return "__init__", lowest  # a name that the face shows


def trespasses(source: str, module: str, face: bool = False) -> list[str]:
    """Imports that a module may not have, anywhere up the folders that it lies in."""
    bad = []
    for name in imports(source, module, face):
        if name.split(".")[0] != module.split(".")[0]:
            allowed = name == "rso" and face and module == "fem_backend"
            own = module.removeprefix("fem_backend.")
            allowed |= name.startswith("rso.contract") and (own in SEAM or own.split(".")[0] in OPEN)
        else:
            allowed = not _uphill(module, name, face)
        if not allowed:
            bad.append(f"{module} imports {name}")
    return bad


def _uphill(module: str, name: str, face: bool) -> bool:
    """Whether `name` lies no lower than `module` in the deepest folder that holds both."""
    parts = module.split(".") if face else module.split(".")[:-1]
    for n in range(len(parts), 0, -1):
        folder = ".".join(parts[:n])
        if name == folder or name.startswith(folder + "."):
            mine = ("__init__", step_of(folder, folder)[1]) if module == folder else step_of(folder, module)
            other = step_of(folder, name)
            return other[0] == mine[0] or (other[1] >= mine[1] and other[1] >= 0)
    return True


@functools.cache
def modules() -> tuple[tuple[str, Path, bool], ...]:
    """Every module of both packages: its dotted name, its file, and whether it is the face of a folder."""
    found = []
    for path in sorted(p for package in PACKAGES for p in (ROOT / package).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        face = parts[-1] == "__init__"
        found.append((".".join(parts[:-1] if face else parts), path, face))
    return tuple(found)


def test_the_list_is_complete():
    for folder in (name for name, _, face in modules() if face):
        k = folder.count(".") + 1
        inside = {name.split(".")[k] for name, _, _ in modules() if name.startswith(folder + ".")}
        listed = " ".join(LAYERS.get(folder, ())).split()
        missing = inside ^ (set(listed) - {"__init__", "*"})
        assert not missing or ("*" in listed and missing <= inside), folder
        assert len(set(listed)) == len(listed), folder


@pytest.mark.parametrize("folder", LAYERS)
def test_no_room_is_deeper_than_a_reader_can_follow(folder):
    assert folder in PACKAGES or len([line for line in LAYERS[folder] if line != "__init__"]) <= DEEPEST


def test_imports_lead_downwards_only():
    assert [bad for name, path, face in modules() for bad in trespasses(path.read_text("utf-8"), name, face)] == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("rso.evaluation.store", "from rso.optimise import choose"),
        ("rso.contract", "import rso.core.units"),
        ("rso.core.curves", "def f():\n    from rso import calibration"),
        ("rso.doe.box", "if True:\n    import numpy, rso.calibration.plan"),
        ("rso.cli.commands", "from fem_backend.backend import BACKEND"),
        ("rso.cli.commands", "import fem_backend"),
        ("rso.doe.box", "from ..optimise import front"),
        ("rso.calibration.plan", "from rso.calibration.pipeline import run"),
        ("rso.calibration.plan", "from . import pipeline"),
        ("rso.discrepancy.library.tables", "from rso.discrepancy.evidence.noise import Noise"),
        ("rso.discrepancy.evidence.noise", "from rso.discrepancy import diagnose"),
        ("fem_backend.solver.newton", "from rso.contract import Case"),
        ("fem_backend.backend", "from rso.core.units import quantity"),
        ("fem_backend.backend", "import rso"),
        ("fem_backend.kinematics.tetrahedra", "from fem_backend.solver import newton"),
    ],
)
def test_a_forbidden_import_is_caught(module, source):
    assert len(trespasses(source, module)) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("rso.cli.commands", "from rso import __version__\nfrom rso.optimise import choose\nimport numpy"),
        ("rso.study.schema", "from .errors import Problem\nfrom ..contract import Case\nfrom . import fields"),
        ("rso.discrepancy.study_diagnosis", "from rso.discrepancy import diagnose"),
        (
            "fem_backend.backend",
            "from rso.contract import Case\nfrom fem_backend import laws\nfrom fem_backend.solver import newton",
        ),
    ],
)
def test_allowed_imports_pass(module, source):
    assert trespasses(source, module) == []


def test_the_picture_in_docs_is_of_these_imports():
    spec = importlib.util.spec_from_file_location("architecture", ROOT / "docs/figures/architecture.py")
    architecture = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(architecture)
    assert architecture.FILE.read_text("utf-8") == architecture.picture()  # else: python docs/figures/architecture.py


def test_a_new_module_is_in_the_picture(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("architecture", ROOT / "docs/figures/architecture.py")
    architecture = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(architecture)
    monkeypatch.setattr(architecture, "ROOT", tmp_path)
    for name, text in (("low", '"""Low."""'), ("high", '"""High."""\nfrom rso import low'), ("__init__", "")):
        for package in architecture.PACKAGES:
            (tmp_path / package).mkdir(exist_ok=True)
            (tmp_path / package / f"{name}.py").write_text(text.replace("rso", package), encoding="utf-8")
    assert architecture.floors("rso") == [["low"], ["high"]]
    assert "High." in architecture.picture()
    (tmp_path / "rso" / "low.py").write_text("from rso import high", encoding="utf-8")
    with pytest.raises(ValueError, match="import one another: high, low"):
        architecture.floors("rso")
