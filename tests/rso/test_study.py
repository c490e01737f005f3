"""study.toml: what is right loads to numbers with units; what is wrong is answered at its line, all at once."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import sample_studies as studies

from rso.calibration.plan import make_plan
from rso.contract import Parameter
from rso.study import cases
from rso.study.errors import StudyError
from rso.study.line_numbers import line_of, toml_lines
from rso.study.loader import load_study
from rso.study.resolve import resolve
from rso.study.schema import Study

GOOD = """\
[study]
title = "Test"
seed = 0

[backend]
use = "fake.backend:BACKEND"
timeout = "10 min"
[backend.settings]
support = { kind = "bowl", friction = 0.2 }
material = { law = "neo_hookean" }

[parameters]
mu = { low = "3356 Pa", high = "36765 Pa", scale = "log" }
D1 = { low = 1, high = "168 1/MPa" }
friction = { value = "20 %" }

[[experiments]]
name = "top"
role = "fit"
data = "top.csv"
settings = { point = [0.0, 0.0], support = { kind = "fixed" } }
noise = { Fz = "10 mN", depth = "20 um", gain = "1 %", correlation = 0.2 }

[[experiments]]
name = "profile"
role = "validate"
kind = "profile"
data = "profile.csv"
after = ["top"]

[search]
targets = [
  { experiment = "top", depth = "2 mm" },
  { experiment = "top", depth = 3.9, value = "500 mN" },
]
constraints = [{ experiment = "top", channel = "uz", depth = 4, low = "-4 mm" }]

[[search.variants]]
name = "narrow"
ranges = { mu = ["7500 Pa", "9.5 kPa"] }

[verify]
tolerance = "0.5 %"
"""
MU = Parameter("mu", "shear modulus", "MPa", 1e-6, 1.0)
D1 = Parameter("D1", "compressibility", "1/MPa", 1e-3, 1e4)
FRICTION = Parameter("friction", "friction", "1", 0.0, 0.6, neutral=0.0)
KNOWN = (MU, D1, FRICTION)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "top.csv").write_text("depth_mm,Fz_N\n" + "".join(f"{k / 10},{k / 80}\n" for k in range(41)))
    (tmp_path / "profile.csv").write_text("depth_mm,x_mm,y_mm,uz_mm\n1,0,5,-0.1\n1,5,5,-0.05\n")
    return tmp_path


def save(folder: Path, text: str) -> Path:
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return folder / "study.toml"


def problems(folder: Path, text: str) -> tuple[str, ...]:
    with pytest.raises(StudyError) as caught:
        load_study(save(folder, text))
    return caught.value.problems


def test_a_good_study(folder):
    study = load_study(save(folder, GOOD))
    assert isinstance(study, Study)
    assert study.backend.timeout == 600.0
    assert study.search.targets[1].value == 0.5 and study.search.targets[0].value is None
    assert study.search.constraints[0].low == -4.0
    assert study.verify.tolerance == 0.005
    noise = study.experiment("top").noise.noise()
    assert (noise.Fz, noise.depth, noise.gain, noise.correlation, noise.of("Fx")) == (0.01, 0.02, 0.01, 0.2, 0.01)
    assert study.settings_of("top") == {
        "support": {"kind": "fixed"},  # replaced whole: no friction of a bowl is left behind
        "material": {"law": "neo_hookean"},
        "point": [0.0, 0.0],
    }
    assert study.settings_of("profile")["support"]["kind"] == "bowl"
    assert study.experiment("profile").compared == ("uz",)
    assert study.measurement("top").channels == ("Fz",)
    assert (study.file, study.folder) == (folder / "study.toml", folder)
    assert load_study(folder).model_dump() == study.model_dump()  # the folder stands for the study.toml inside


def test_seed_zero_is_a_seed_and_defaults_are_there(folder):
    study = load_study(save(folder, GOOD))
    assert study.study.seed == 0
    assert (study.doe.kind, study.doe.runs, study.doe.reduce) == ("lhs", 40, True)
    assert (study.search.metric, study.search.candidates, study.diagnose.effects) == ("nrmse", 3, "all")


def test_models_are_frozen(folder):
    study = load_study(save(folder, GOOD))
    with pytest.raises(ValueError, match="frozen"):
        study.doe.runs = 3


def test_resolve_gives_units(folder):
    r = resolve(load_study(save(folder, GOOD)), KNOWN)
    assert [(a.name, a.low, a.high, a.scale) for a in r.axes] == [
        ("mu", 0.003356, 0.036765, "log"),
        ("D1", 1.0, 168.0, "linear"),
    ]
    assert dict(r.fixed) == {"friction": 0.2}
    (variant,) = r.variants
    assert variant.targets == r.study.search.targets
    assert [(a.low, a.high) for a in variant.axes] == [(0.0075, 0.0095), (1.0, 168.0)]


def at(text: str, fragment: str) -> int:
    """Line of a fragment."""
    return text[: text.index(fragment)].count("\n") + 1


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ('title = "Test"', 'titel = "Test"', "study.titel", ["unknown key", "'title'", "seed, title, units"]),
        ("seed = 0", "seed = true", "study.seed", ["True", "valid integer"]),
        ("seed = 0", 'seed = "0"', "study.seed", ["'0'", "valid integer"]),
        ("seed = 0", "seed = -1", "study.seed", ["-1", "greater than or equal to 0"]),
        ("seed = 0", 'seed = 0\nunits = "SI"', "study.units", ["'SI'", "N-mm-MPa-s"]),
        ('use = "fake.backend:BACKEND"', 'use = "fake.backend"', "backend.use", ["package.module:NAME"]),
        ('use = "fake.backend:BACKEND"', "", "backend", ["either use", "command"]),
        ('timeout = "10 min"', 'timeout = "10 mm"', "backend.timeout", ["'10 mm'", "in s", "1 min"]),
        ('law = "neo_hookean"', "law = 2020-01-01", "backend.settings", ["2020-01-01", "cannot be handed"]),
        ('law = "neo_hookean"', "law = nan", "backend.settings", ["nan", "cannot be handed"]),
        ('scale = "log"', 'scale = "loq"', "parameters.mu.scale", ["'loq'", "'linear' or 'log'", "did you mean 'log'"]),
        ("D1 = { low = 1,", "D1 = { low = true,", "parameters.D1.low", ["True", "expected a number"]),
        ("D1 = { low = 1,", "D1 = { low = inf,", "parameters.D1.low", ["inf", "finite"]),
        ("D1 = { low = 1,", "D1 = { ", "parameters.D1", ["low and high"]),
        ("D1 = { low = 1,", "D1 = { lo = 1, low = 1,", "parameters.D1.lo", ["did you mean 'low'"]),
        ('role = "validate"', 'role = "valid"', "experiments[1].role", ["'valid'", "did you mean 'validate'?"]),
        ('role = "fit"', "", "experiments[0].role", ["is missing"]),
        ('role = "fit"', 'role = "select"', "experiments", ['role = "fit"']),
        ('name = "profile"', 'name = "top"', "experiments[1].name", ["'top'", "taken"]),
        ('name = "profile"', 'name = "../x"', "experiments[1].name", ["'../x'", "letters, digits, blanks"]),
        ('after = ["top"]', 'after = ["topp"]', "experiments[1].after", ["'topp'", "did you mean 'top'"]),
        ('after = ["top"]', 'after = "top"', "experiments[1].after", ["'top'", "array"]),
        ('data = "top.csv"', 'data = "tip.csv"', "experiments[0].data", ["'tip.csv'", "no such file"]),
        ('data = "top.csv"', 'data = "profile.csv"', "experiments[0].kind", ["'force'", "profile"]),
        ('data = "top.csv"', 'data = "top.csv"\nchannels = ["Fx"]', "experiments[0].channels", ["'Fx'", "Fz"]),
        ('Fz = "10 mN"', 'Fz = "10 mm"', "experiments[0].noise.Fz", ["'10 mm'", "in N"]),
        ('Fz = "10 mN"', 'Fz = "-10 mN"', "experiments[0].noise.Fz", ["greater than or equal to 0"]),
        ('gain = "1 %"', 'Gain = "1 %"', "experiments[0].noise.Gain", ["did you mean 'gain'"]),
        (
            'depth = "2 mm" }',
            'depth = "20 mm" }',
            "search.targets[0].depth",
            ["20", "outside the measured range 0 to 4"],
        ),
        ('depth = "2 mm" }', 'depth = 2, channel = "Fx" }', "search.targets[0].channel", ["'Fx'", "choose from Fz"]),
        ('experiment = "top", depth = "2', 'experiment = "tob", depth = "2', "search.targets[0].experiment", ["'top'"]),
        (
            'experiment = "top", depth = "2',
            'experiment = "profile", depth = "2',
            "search.targets[0].experiment",
            ["valid"],
        ),
        ('value = "500 mN"', 'value = "500 mm"', "search.targets[1].value", ["'500 mm'", "in N"]),
        ('low = "-4 mm"', 'low = "-4 N"', "search.constraints[0].low", ["'-4 N'", "in mm"]),
        (', low = "-4 mm"', "", "search.constraints[0]", ["low, high or both"]),
        ("ranges = { mu =", "ranges = { nu =", "search.variants[0].ranges.nu", ["did you mean 'mu'"]),
        ('["7500 Pa", "9.5 kPa"]', '["7500 Pa"]', "search.variants[0].ranges.mu[1]", ["missing"]),
        ('tolerance = "0.5 %"', 'tolerance = "0.5"', "verify.tolerance", ["'0.5'", "without a unit", '"1 %"']),
        ('tolerance = "0.5 %"', "max_infill = 1.5", "verify.max_infill", ["1.5", "integer"]),
        ("[verify]", '[identify]\nrequire = ["D2"]\n[verify]', "identify.require[0]", ["'D2'", "D1, mu"]),
        ("[verify]", '[identify]\nrequire = ["friction"]\n[verify]', "identify.require[0]", ["not searched for"]),
        ("[verify]", '[doe]\nkind = "LHS"\n[verify]', "doe.kind", ["'LHS'", "box_behnken"]),
        ("[verify]", '[doe]\nkind = "file"\n[verify]', "doe", ["must be given together"]),
        ("[verify]", '[doe]\nkind = "file"\nfile = "x.csv"\n[verify]', "doe.file", ["'x.csv'", "no such file"]),
        ("[verify]", "[diagnose]\neffects = 3\n[verify]", "diagnose.effects", ["3", '"all" or a list']),
        ("[verify]", "[verifi]\n[verify]", "verifi", ["unknown key", "did you mean 'verify'"]),
        ("[verify]", "[dispatch]\njobs = 0\n[verify]", "dispatch.jobs", ["0", "greater than or equal to 1"]),
    ],
)
def test_one_mistake_is_one_problem_at_its_line(folder, old, new, key, words):
    assert GOOD.count(old) >= 1
    text = GOOD.replace(old, new, 1)
    found = problems(folder, text)
    match = [p for p in found if re.match(rf".*study\.toml:\d+: {re.escape(key)}( = .*)?: ", p)]
    assert len(match) == 1, found
    for word in words:
        assert word in match[0]
    # The key itself where it is written down, else the table that lacks it.
    path = tuple(int(k) if k.isdigit() else k for k in re.findall(r"\w+", key))
    assert f"study.toml:{line_of(toml_lines(text), path)}: " in match[0]
    # A misspelt required key is also missing, a wrong role leaves nothing to fit; nothing else may cascade.
    assert len(found) == (2 if key in ("study.titel", "experiments[0].role") else 1), found


def test_lines_are_those_an_editor_shows(folder):
    for old, new in [('depth = "2 mm" }', 'depth = "20 mm" }'), ('role = "validate"', 'role = "valid"')]:
        text = GOOD.replace(old, new, 1)
        assert any(p.startswith(f"{folder / 'study.toml'}:{at(text, new)}: ") for p in problems(folder, text))


def test_a_circle_of_tests_is_one_problem(folder):
    text = GOOD.replace('name = "top"', 'name = "top"\nafter = ["profile"]', 1)
    (only,) = problems(folder, text)
    assert "experiments[0].after" in only and "comes after itself: top, profile, top" in only


def test_a_name_that_is_taken_is_no_circle(folder):
    third = '[[experiments]]\nname = "top"\nrole = "fit"\ndata = "top.csv"\nafter = ["profile"]\n\n[search]'
    found = problems(folder, GOOD.replace("[search]", third, 1))
    assert any("this name is taken" in p for p in found) and not any("comes after itself" in p for p in found)


def test_all_problems_at_once_in_order_of_lines(folder):
    text = GOOD
    for old, new in [
        ("seed = 0", "seed = 1.5"),
        ('scale = "log"', 'scale = "loq"'),
        ('data = "top.csv"', 'data = "tip.csv"'),
        ('after = ["top"]', 'after = ["tip"]'),
        ("depth = 3.9", "depth = -3.9"),
        ('tolerance = "0.5 %"', 'tolerance = "2 MPa"'),
    ]:
        text = text.replace(old, new, 1)
    found = problems(folder, text)
    assert len(found) == 6, found
    lines = [int(re.search(r"study\.toml:(\d+):", p)[1]) for p in found]
    assert lines == sorted(lines)
    with pytest.raises(StudyError) as caught:
        load_study(folder)
    assert str(caught.value).count("\n") == 5 and "Traceback" not in str(caught.value)


def test_a_bad_data_file_is_reported_with_its_own_line(folder):
    (folder / "top.csv").write_text("depth_mm,Fz_N\n1,2\n2,x\n")
    (problem,) = problems(folder, GOOD)
    assert "experiments[0].data" in problem and f"{folder / 'top.csv'}:3" in problem and "'x'" in problem


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", [":1:", "study", "missing"]),
        (b"x = ", [":1:", "not valid TOML"]),
        (b"[study]\nseed = 1\nseed = 2\n", [":3:", "not valid TOML"]),
        (b"[study\n", [":1:", "not valid TOML"]),
        (b"\x89PNG\r\n\x00\xff\xfe", [":1:", "not UTF-8"]),
        (b"[study]\ntitle = '\xfcber'\n", [":2:", "not UTF-8"]),
        (b"\0\0\0", [":1:", "not valid TOML"]),
        (b"x = " + b"[\n" * 50_000, ["nested too deeply"]),
        (b"x = " + b"1" * 9_000, ["not valid TOML"]),
        (b"a = 1\n" + b"a." * 10_000 + b"a = 1\n", [":2:", "a line of 20005 characters"]),
        (b"#" * 5_000_001, ["too large"]),
        (b"study = 3\nbackend = []\nparameters = 1\nexperiments = {}\n", [":1:", ":4:", "table", "array"]),
        (b"[experiments]\nname = 3\n[search]\ntargets = 3\nvariants = [1]\n", ["array", "table"]),
    ],
)
def test_files_that_are_no_study(folder, content, words):
    (folder / "study.toml").write_bytes(content)
    with pytest.raises(StudyError) as caught:
        load_study(folder / "study.toml")
    for word in [str(folder / "study.toml"), *words]:
        assert word in str(caught.value)


def test_missing_files_name_their_neighbours(folder):
    save(folder, GOOD)
    with pytest.raises(StudyError, match=r"no such study file; did you mean 'study\.toml'"):
        load_study(folder / "stud.toml")
    with pytest.raises(StudyError, match="no such study file"):
        load_study(folder / "nowhere" / "study.toml")
    with pytest.raises(StudyError, match=r"not a path|no such"):
        load_study("a\0b")


def test_byte_order_mark_and_windows_line_ends_do_not_matter(folder):
    expected = load_study(save(folder, GOOD))
    (folder / "study.toml").write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    study = load_study(folder)
    assert study.model_dump() == expected.model_dump() and study.lines == expected.lines


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ("friction = {", "frictoin = {", "parameters.frictoin", ["did you mean 'friction'", "D1, friction, mu"]),
        ("3356 Pa", "3356 mm", "parameters.mu.low", ["'3356 mm'", "in MPa"]),
        ('"3356 Pa"', '"0.0001 Pa"', "parameters.mu.low", ["hard bounds", "[1e-06, 1] MPa"]),
        ("36765 Pa", "3000 Pa", "parameters.mu", ["must be below"]),
        ("20 %", "70 %", "parameters.friction.value", ["hard bounds"]),
        ("9.5 kPa", "95 kPa", "search.variants[0].ranges.mu", ["inside the study's range [0.003356, 0.036765] MPa"]),
        ("ranges = { mu =", "ranges = { friction =", "search.variants[0].ranges.friction", ["fixed value"]),
    ],
)
def test_resolve_answers_at_the_line(folder, old, new, key, words):
    text = GOOD.replace(old, new, 1)
    with pytest.raises(StudyError) as caught:
        resolve(load_study(save(folder, text)), KNOWN)
    match = [p for p in caught.value.problems if f"study.toml:{at(text, new)}: {key}" in p]
    assert len(match) == 1, caught.value.problems
    for word in words:
        assert word in match[0]


def test_a_derived_quantity_is_told_from_what_it_follows(folder):
    """Who states a Poisson's ratio learns what to state in its place, and a typing mistake the nearest names."""
    text = GOOD.replace("friction = {", "nu = {", 1)
    with pytest.raises(StudyError, match=r"parameters.nu: Poisson's ratio follows from mu and D1: state these"):
        resolve(load_study(save(folder, text)), KNOWN, {"nu": "Poisson's ratio follows from mu and D1"})


def test_the_backend_says_from_what_its_quantities_follow(tmp_path):
    import rso

    (tmp_path / "c.csv").write_text("depth_mm,Fz_N\n" + "".join(f"{0.01 * k},{0.001 * k**1.5}\n" for k in range(30)))
    parts = {"specimen": {"shape": "half_space"}, "indenter": {"shape": "sphere", "radius": 3.0}}
    for name, parents in (("nu", "mu and D1"), ("K", "D1")):
        with pytest.raises(StudyError, match=f"parameters.{name}: .* follows from {parents}: state these"):
            rso.fit(tmp_path / "c.csv", **parts, parameters={name: 0.4}, folder=tmp_path / name)


def test_log_scale_needs_a_positive_start(folder):
    text = GOOD.replace("D1 = { low = 1,", 'D1 = { scale = "log", low = 0,')
    zero = Parameter("D1", "compressibility", "1/MPa", 0.0, 1e4)
    with pytest.raises(StudyError, match="a log scale needs low > 0 1/MPa"):
        resolve(load_study(save(folder, text)), (MU, zero, FRICTION))


def places(value, place=()):
    """Every place in parsed TOML."""
    if place:
        yield place
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield from places(inner, (*place, key))


TRICKY = '''# [not.a.table]
a.b."c.d" = "# no = [comment]" # comment
text = """
[fake]
x = 1 \\""" ""\\"
"""
raw = \'\'\'a = ']'
\'\'\'\'
[ t . "u v" ]
list = [ 1, # one
  [2, 3], "]", {x = 1, y = {z = "}"}},
]
when = 1979-05-27 07:32:00
[[t.many]]
[[t.many]]
[t.many.sub]
k = 1
[[t.many.deep]]
k = 2
'''


@pytest.mark.parametrize("text", [GOOD, TRICKY])
def test_scanner_finds_every_place_that_the_parser_finds(text):
    """Oracle: tomllib.  Lines: deleting nothing, the key must be written in the line it is said to be in."""
    lines = toml_lines(text)
    assert set(places(tomllib.loads(text))) == set(lines)
    for place, line in lines.items():
        key = next(k for k in reversed(place) if isinstance(k, str))
        if isinstance(place[-1], str):
            assert key in text.split("\n")[line - 1]
    assert toml_lines(GOOD)[("search", "targets", 1, "depth")] == at(GOOD, "depth = 3.9")


# ------------------------------------------------------------------------------------------------------ laboratory

TOP = studies.SECTIONS["[experiments]"]
PROFILE = 'name = "surface"\nrole = "{role}"\nkind = "profile"\ndata = "surface.csv"\n'
SURFACE = "depth_mm,x_mm,y_mm,uz_mm\n" + "".join(f"{u},{x},5,{-0.1 * u}\n" for u in (1, 2) for x in (-5, 0, 5))


def laboratory(folder: Path, experiments: str, surface: str = SURFACE, **changes: str) -> Path:
    (folder / "surface.csv").write_text(surface)
    return studies.write(folder, experiments=experiments, **changes)


def refused(folder: Path, experiments: str, **changes: str) -> str:
    with pytest.raises(StudyError) as caught:
        make_plan(load_study(laboratory(folder, experiments, **changes)))
    (problem,) = caught.value.problems
    return problem


def also(role: str = "validate", more: str = "") -> str:
    """The fitted curve and a profile."""
    return f"{TOP}\n[[experiments]]\n{PROFILE.format(role=role)}{more}"


@pytest.mark.parametrize(
    ("experiments", "changes", "words"),
    [
        (also(), {}, ["experiments[1].kind = 'profile'", "'layer' has no profiles", "unknown settings ['profile']"]),
        (also("fit"), {}, ["has no profiles"]),
        (TOP + "\nsettings = { unload = 1 }", {}, ["experiments[0].settings.unload", "true or false is expected"]),
        (TOP, {"backend__settings": 'unload = "no"'}, ["backend.settings.unload", "unload = 'no'"]),
        (TOP.replace("top.csv", "surface.csv"), {}, ["experiments[0].kind = 'force'", "those of a profile"]),
        (also(), {"surface": "depth_mm,x_mm,uz_mm\n1,0,-1\n"}, ["a profile needs the columns x_mm and y_mm"]),
        (also(), {"surface": "depth_mm,x_mm,y_mm,uz_mm\n0,0,5,0\n"}, ["no depth is positive"]),
        (also(), {"surface": SURFACE + "2,7,5,0\n" * cases.MAX_DISPLACEMENTS}, ["3006 displacements", "at most 3000"]),
    ],
)
def test_what_is_wrong_with_a_laboratory_is_said_at_its_line(tmp_path, experiments, changes, words):
    problem = refused(tmp_path, experiments, **changes)
    assert all(w in problem for w in words), problem


@pytest.fixture
def marked(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """A backend that moves the marks of a profile."""
    monkeypatch.setattr(studies.indentation_backend, "MARKED", studies.Marked(), raising=False)
    return {"backend": 'use = "indentation_backend:MARKED"'}


def test_a_profile_alone_is_nothing_to_fit(tmp_path, marked):
    only = PROFILE.format(role="fit")
    assert "experiments: profiles are not fitted" in refused(tmp_path, only, search="population = 20", **marked)


def test_other_channels_and_constraints_are_none_of_a_profile(tmp_path, marked):
    surface = "depth_mm,x_mm,y_mm,uz_mm,ux_mm\n1,0,5,-0.1,0\n"
    problem = refused(tmp_path, also(more='channels = ["ux"]'), surface=surface, **marked)
    assert "experiments[1].channels" in problem and "vertical displacements" in problem
    limit = '\nconstraints = [{ experiment = "surface", channel = "Fz", depth = 1, low = 0 }]'
    search = studies.SECTIONS["search"]
    for role, words in (("fit", "is a profile"), ("validate", "for validation")):
        problem = refused(tmp_path, also(role), search=search + limit, **marked)
        assert "search.constraints[0].experiment" in problem and words in problem


def test_a_profile_asks_for_its_depths_and_marks(tmp_path, marked):
    """Where depths scatter from mark to mark, as many travels as for a curve are enough."""
    plan = make_plan(load_study(laboratory(tmp_path, also(more="settings = { thickness = 6, speed = 2 }"), **marked)))
    case = plan.validation["surface"]
    assert case.settings == {"thickness": 6, "speed": 2, "profile": [[-5.0, 5.0], [0.0, 5.0], [5.0, 5.0]]}
    assert (case.programme.asked_mm, case.programme.time_s) == ((1.0, 2.0), (0.0, 1.0))
    assert set(plan.case_of) == {"top"} and not any("profile" in c.settings for c in plan.cases)
    u = 2 + 0.5 * np.sort(np.random.default_rng(0).random(40))
    rows = [f"{a!r},{x},-0.0,-0.1\n" for x, a in enumerate(u.tolist())] + ["-0.01,0,0,0\n", "2.50001,41,0,0\n"]
    plan = make_plan(load_study(laboratory(tmp_path, also(), "depth_mm,x_mm,y_mm,uz_mm\n" + "".join(rows), **marked)))
    case = plan.validation["surface"]
    assert len(case.programme.asked_mm) == cases.N_CURVE_TRAVELS and case.programme.asked_mm[-1] == 2.50001
    assert case.settings["profile"][0] == [0.0, 0.0] and "-0.0" not in str(case.settings["profile"])


def test_a_depth_that_is_read_twice_is_asked_for_once(tmp_path, marked):
    surface = "depth_mm,x_mm,y_mm,uz_mm\n" + "".join(f"{u},{k},0,-.1\n" for k, u in enumerate((1, 1.0005, 2, 1.9995)))
    plan = make_plan(load_study(laboratory(tmp_path, also(), surface, **marked)))
    assert plan.validation["surface"].programme.asked_mm == (1.0005, 2.0)


@pytest.mark.parametrize("where", ["experiment", "backend"])
def test_that_a_test_also_unloads_is_no_matter_of_the_simulation(tmp_path, where):
    (tmp_path / "top.csv").write_text(studies.measured() + "1.5,0.01\n1.0,0.005\n0.5,0.0\n")
    unload = {"experiments": TOP + "\nsettings = { unload = true }", "backend__settings": "thickness = 8"}
    if where == "backend":
        unload = {"experiments": TOP, "backend__settings": "thickness = 8\nunload = true"}
    plan = make_plan(load_study(studies.write(tmp_path, **unload)))
    (case,) = plan.cases
    assert case.settings == {"thickness": 8} and case.programme.travel_mm == (0.0, 2.0)
    assert len(plan.curves["top"].depth) == 20 and np.all(np.diff(plan.curves["top"].value) > 0)
    assert cases.remarks(plan.study, "top") == [cases.LOADING_COMPARED_NOTE]
    (tmp_path / "top.csv").write_text(studies.measured())
    assert cases.remarks(load_study(studies.write(tmp_path)), "top") == []


def recorded(speed: float) -> str:
    """The measured curve with the times of a loading at this speed (mm/s)."""
    head, *rows = studies.measured().strip().splitlines()
    return "\n".join([f"time_s,{head}", *(f"{float(r.split(',')[0]) / speed!r},{r}" for r in rows), ""])


@pytest.mark.parametrize(
    ("stated", "own", "speed", "whose"),
    [
        (None, 0.01, 0.01, "by its times"),
        ("30 mm/min", 0.01, 0.01, "by its times"),
        ("30 mm/min", 0.51, 0.5, "as stated"),
        ("30 mm/min", None, 0.5, "as stated"),
        (None, None, cases.DEFAULT_SPEED_MM_S, "assumed"),
    ],
)
def test_a_test_is_simulated_as_fast_as_its_record_says(tmp_path, stated, own, speed, whose):
    """One that took 300 s was simulated in 6, and what relaxes came out fifty times too quick, without a word."""
    (tmp_path / "top.csv").write_text(studies.measured() if own is None else recorded(own))
    experiments = TOP + (f'\nsettings = {{ speed = "{stated}" }}' if stated else "")
    study = load_study(studies.write(tmp_path, experiments=experiments))
    assert cases.speed_of(study, "top") == (pytest.approx(speed, rel=1e-3), whose)
    (case,) = make_plan(study).cases
    assert case.programme.time_s[-1] == pytest.approx(2.0 / speed, rel=1e-3)


@pytest.mark.parametrize("speed", ['"fast"', '"-3 mm/s"', '"0 mm/s"'])
def test_a_speed_that_is_none_is_refused_where_it_stands(tmp_path, speed):
    (tmp_path / "top.csv").write_text(studies.measured())
    with pytest.raises(StudyError, match=r"study\.toml:\d+: experiments\[0\]\.settings\.speed"):
        make_plan(load_study(studies.write(tmp_path, experiments=f"{TOP}\nsettings = {{ speed = {speed} }}")))
