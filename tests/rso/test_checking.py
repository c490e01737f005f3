"""`rso check`: what the backend takes an experiment for, and that what others refuse is not called good."""

import re
from pathlib import Path

import pytest
import sample_studies as studies

from rso.cli.checking import check_lines
from rso.study.errors import StudyError
from rso.study.loader import load_study

OWN = {
    "backend": 'use = "fem_backend.backend:BACKEND"',
    "backend__settings": "indenter = { radius = 5.0, shaft = true }\nsupport = { kind = 'bowl', clearance = 2.0 }",
    "search": None,
}
SECOND = 'name = "side"\nrole = "fit"\ndata = "side.csv"\nnoise = { Fz = "0.02 mN", contact = "0 mm" }\n'


def said(folder: Path, settings: str = "", trust: bool = False, **changes: str | None) -> list[str]:
    """Lines of a check of a study with a second experiment that has settings of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "side.csv").write_text("# the same again\n" + studies.measured())
    both = "\n[[experiments]]\n".join([studies.SECTIONS["[experiments]"], SECOND + settings])
    return check_lines(
        load_study(studies.write(folder, **{**OWN, "experiments": both, **changes})), folder / "results", trust
    )


def whole(lines: list[str]) -> list[str]:
    """Lines with their continuations."""
    return re.sub(r"\n {6}", " ", "\n".join(lines)).split("\n")


@pytest.mark.usefixtures("no_library")
def test_what_the_backend_takes_an_experiment_for(tmp_path):
    bowl = "support = { kind = 'bowl' }"
    lines = whole(said(tmp_path, f"settings = {{ point = [10.0, 0.0], indenter = {{ shaft = false }}, {bowl} }}"))
    stated = next(line for line in lines if "settings as stated" in line)
    assert "indenter.radius = 5.0" in stated and "indenter.shaft = true" in stated and "bowl_clearance = 2.0" in stated
    default = next(line for line in lines if "default" in line)
    assert "specimen.semi_axes = [60.0, 35.0, 35.0]" in default and "indenter.radius" not in default
    at = next(n for n, line in enumerate(lines) if "'side'" in line)
    own, *_ = (line for line in lines[at:] if "differs" in line)
    for words in (
        "point = [10.0, 0.0] (study: [0.0, 0.0])",
        "indenter.radius = 3.0 (study: 5.0)",
        "indenter.shaft = false (study: true)",
        "bowl_clearance = 1.0 (study: 2.0)",
    ):
        assert words in own
    assert not any("differs" in line for line in lines[:at])


@pytest.mark.usefixtures("no_library")
def test_what_the_backend_works_out_of_a_statement_is_no_statement(tmp_path):
    """The size that a cavity would have follows from the semi-axes."""
    lines = said(tmp_path, backend__settings="specimen = { semi_axes = [50.0, 40.0, 30.0] }")
    stated = next(line for line in lines if "settings as stated" in line)
    assert "specimen.semi_axes = [50.0, 40.0, 30.0]" in stated and "cavity" not in stated
    assert any("specimen.cavity" in line for line in lines if "by the backend" in line)


@pytest.mark.usefixtures("no_library")
def test_a_statement_that_equals_the_default_is_a_statement(tmp_path):
    """Negative control: what is not stated is said to be the backend's."""
    lines = whole(said(tmp_path, backend__settings="specimen = { semi_axes = [60.0, 35.0, 35.0] }"))
    stated = next(line for line in lines if "settings as stated" in line)
    default = next(line for line in lines if "by the backend" in line)
    assert "specimen.semi_axes = [60.0, 35.0, 35.0]" in stated and "specimen.semi_axes" not in default
    assert "indenter.radius" in default and "indenter.radius" not in stated


@pytest.mark.usefixtures("no_library")
def test_what_only_the_form_of_the_backend_has_is_not_said(tmp_path):
    """A body that may turn in its bowl has a number in its key that no study can state."""
    bowl = "support = { kind = 'bowl' }"
    text = "\n".join(said(tmp_path, f"settings = {{ point = [10.0, 0.0], indenter = {{ shaft = false }}, {bowl} }}"))
    assert "point = [10.0, 0.0] (study: [0.0, 0.0])" in re.sub(r"\n {6}", " ", text)
    assert "rolling" not in text and "null" not in text


@pytest.mark.usefixtures("no_library")
def test_a_table_that_replaces_that_of_the_study_is_remarked_upon(tmp_path):
    lines = said(tmp_path, "settings = { indenter = { shaft = false } }")
    (line,) = (line for line in lines if "as a whole" in line)
    assert "settings.indenter" in line and "radius = 5.0" in line and "shaft" not in line.split("as a whole")[1]
    lines = said(tmp_path, "settings = { indenter = { shaft = false, radius = 5.0 } }")
    assert not any("as a whole" in line for line in lines)
    foreign = {"backend": studies.SECTIONS["backend"], "backend__settings": "thickness = { mean = 8.0, error = 1 }"}
    lines = said(tmp_path, "settings = { thickness = { mean = 9.0 } }", **foreign)  # without its backend too
    assert any("as a whole" in line and "error = 1" in line for line in lines)


def test_what_a_diagnosis_simulates_beyond_its_library_is_counted(tmp_path):
    """In a bowl that takes longer than held, and nothing of it was run yet."""
    times = []
    for kind in ("fixed", "bowl"):
        own = {**OWN, "backend__settings": f"support = {{ kind = '{kind}' }}", "diagnose": ""}
        lines = check_lines(load_study(studies.write(tmp_path / kind, **own)), tmp_path / kind / "results", False)
        at = next(n for n, line in enumerate(lines) if "rso diagnose: " in line)
        pattern = r"names two, [1-9]\d* tests that could decide are computed: about \d+ simulations, (.*) (s|min|h)$"
        assert "is simulated again: about" in lines[at + 1]
        m = re.search(pattern, lines[at + 2])
        times.append(float(m[1]) * {"s": 1, "min": 60, "h": 3600}[m[2]])
    assert times[1] > 2.0 * times[0] > 0.0
    own["diagnose"] = None  # who does not ask for a diagnosis waits for none of it
    lines = check_lines(load_study(studies.write(tmp_path / "run", **own)), tmp_path / "run" / "results", False)
    assert not any("names two" in line for line in lines)


TOP = studies.SECTIONS["[experiments]"]
REFUSED = {  # changes of the study, whether its backend is loaded, file line key and choices in the message
    "unknown level": ({"ladder": 'levels = ["hertzz"]'}, ["ladder.levels[0] = 'hertzz'", "did you mean 'hertz'"]),
    "misspelt setting": (
        {"backend__settings": "suport = { kind = 'bowl' }", "experiments": TOP + "\nsettings = { point = [0, 0] }"},
        ["study.toml:9: backend.settings.suport", "did you mean 'support'"],
    ),
    "misspelt key of a setting": (
        {"backend__settings": "indenter = { radus = 5 }"},
        ["backend.settings.indenter", "did you mean 'radius'"],
    ),
    "misspelt choice": (
        {"backend__settings": "support = { kind = 'bowel' }"},
        ["backend.settings.support", "did you mean 'bowl'"],
    ),
    "no such module": (
        {"backend": 'use = "fem_bakend.backend:BACKEND"'},
        ["study.toml:6: backend.use", "no module 'fem_bakend'", "did you mean 'fem_backend'"],
    ),
    "no such program": (
        {"backend": 'command = ["no-such-solver"]'},
        ["study.toml:6: backend.command", "'no-such-solver' of command"],
    ),
    "after each other": (
        {"experiments": f'{TOP}\nafter = ["b"]\n[[experiments]]\n{TOP.replace("top", "b", 1)}\nafter = ["top"]'},
        ["experiments[0].after", "top, b, top"],
    ),
    "after itself": ({"experiments": TOP + '\nafter = ["top"]'}, ["experiments[0].after", "no other experiment"]),
    "two beside what a modulus moves over": (
        {
            "parameters": 'mu = { low = "6 kPa", high = "20 kPa" }\nD1 = { value = 60 }\n'
            "friction = { low = 0.1, high = 0.2 }\ntilt_x = { low = 1, high = 2 }",
            "diagnose": "",
        },
        ["study.toml:15: parameters.tilt_x", "(what stays where the modulus moves, D1, counts as one)"],
    ),
    "three beside the modulus": (
        {
            "parameters": f"{studies.SECTIONS['parameters']}\nfriction = {{ low = 0.1, high = 0.2 }}\n"
            "tilt_x = { low = 1, high = 2 }",
            "diagnose": "",
        },
        ["study.toml:15: parameters.tilt_x", "at most two open parameters besides the modulus"],
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_others_refuse_is_not_called_good(tmp_path, name):
    changes, words = REFUSED[name]
    with pytest.raises(StudyError) as caught:
        check_lines(
            load_study(studies.write(tmp_path, **{**OWN, "backend__settings": "", **changes})),
            tmp_path / "results",
            False,
        )
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    "parameters",
    [
        'mu = { low = "6 kPa", high = "20 kPa" }\nD1 = { value = 60 }',
        'mu = { value = "6 kPa" }\nD1 = { low = 10, high = 150 }',
        'mu = { low = "6 kPa", high = "20 kPa" }\nD1 = { value = 60 }\nfriction = { low = 0.1, high = 0.2 }',
    ],
)
def test_a_diagnosis_with_a_fixed_parameter_is_called_good(tmp_path, parameters):
    own = {**OWN, "backend__settings": "", "parameters": parameters, "diagnose": ""}
    lines = check_lines(load_study(studies.write(tmp_path, **own)), tmp_path / "results", False)
    assert any("rso diagnose: " in line and "a library of" in line for line in lines)


@pytest.mark.parametrize(
    ("D1", "said"),
    [
        ("{ low = 10, high = 400 }", "some of their corners"),
        ("{ value = 600 }", "any of their corners"),
        ("{ low = 10, high = 140 }", ""),
    ],
)
def test_a_negative_poisson_ratio_is_said(tmp_path, D1, said):
    """K/mu below 2/3 where mu D1 is above 3: auxetic bodies exist, but nobody means one without a word."""
    own = {**OWN, "backend__settings": "", "parameters": f'mu = {{ low = "6 kPa", high = "20 kPa" }}\nD1 = {D1}'}
    lines = check_lines(load_study(studies.write(tmp_path, **own)), tmp_path / "results", False)
    found = [line for line in lines if "Poisson" in line]
    assert len(found) == bool(said) and all(said in line and "mu * D1 <= 3" in line for line in found)


def test_a_module_beside_the_study_is_found_and_not_loaded(tmp_path):
    (tmp_path / "solver.py").write_text("raise SystemExit('loaded')")
    study = load_study(studies.write(tmp_path, backend='use = "solver:BACKEND"'))
    assert any("was not loaded" in line for line in check_lines(study, tmp_path / "results", False))


def test_a_name_that_is_none_is_refused_in_words(tmp_path):
    with pytest.raises(StudyError) as caught:
        load_study(studies.write(tmp_path, experiments=TOP.replace('"top"', '"top/left"', 1)))
    assert "letters, digits, blanks and . + - _, at most 64" in str(caught.value) and "\\w" not in str(caught.value)


@pytest.mark.parametrize(("low", "corners"), [("0.05 1/MPa", 2), ("0.3 1/MPa", 1), ("1 1/MPa", 0)])
def test_corners_of_the_ranges_that_nothing_models_are_told_before_a_library_stops_there(
    request, tmp_path, low, corners
):
    """K/mu = 2/(mu D1) beyond 1000: mu from 5 to 20 kPa."""
    if corners != 2:
        request.getfixturevalue("no_library")
    ranges = f'mu = {{ low = "5 kPa", high = "20 kPa" }}\nD1 = {{ low = "{low}", high = "100 1/MPa" }}'
    lines = said(tmp_path, parameters=ranges)
    told = [line for line in lines if "not modelled in" in line]
    assert len(told) == (corners > 0)
    if corners:
        assert told[0].startswith(f"  not modelled in {corners} of 4 corners of these ranges, first mu = 0.005, D1 =")
        assert f"K/mu = {2 / (0.005 * float(low.split()[0])):.4g}" in lines[lines.index(told[0]) + 1]


@pytest.mark.parametrize(("unit", "told"), [("kPa", 0), ("MPa", 2), ("Pa", 2)])
@pytest.mark.usefixtures("no_library")
def test_forces_that_no_modulus_of_the_range_would_have_are_told(tmp_path, unit, told):
    """The same numbers in another unit: a thousand times what Hertz's limit of these forces has, or a thousandth."""
    lines = said(tmp_path, parameters=f'mu = {{ low = "1 {unit}", high = "40 {unit}" }}\nD1 = {{ value = 5.8 }}')
    found = [line for line in lines if "limit of small contacts (Hertz)" in line]
    assert len(found) == 2 and all(re.search(r"μ about [\d.]+ kPa", line) for line in found)
    assert sum("are the units of force and depth right?" in line for line in lines) == told


@pytest.mark.usefixtures("no_library")
def test_what_is_pressed_with_another_indenter_is_called_so(tmp_path):
    """A layer under a flat end: no word of a ball or of Hertz, and which part of a body of revolution is simulated."""
    flat = "specimen = { shape = 'slab', thickness = 8.0 }\nindenter = { shape = 'flat', radius = 2.0, fillet = 0.1 }"
    puck = "settings = { specimen = { shape = 'cylinder', radius = 12.0, height = 10.0 }, point = [4.0, 0.0] }"
    narrow = 'mu = { low = "6 kPa", high = "20 kPa" }\nD1 = { value = 60 }'
    lines = said(tmp_path, puck, backend__settings=flat, parameters=narrow)
    text = "\n".join(lines)
    assert "limit of small contacts (Sneddon): μ about" in text
    assert not re.search(r"\b(ball|[Hh]ertz\w*)\b", text)
    found = [line.strip() for line in lines if "of revolution" in line]
    assert found == [
        "of revolution: solved on its meridian",
        "the specimen is of revolution, its test is not: half of it is solved in space",
    ]


@pytest.mark.usefixtures("no_library")
def test_the_speed_of_a_test_is_said_where_answers_depend_on_it(tmp_path):
    """Whose word it is, too: nobody's is half a millimetre a second."""
    held = {"backend__settings": "support = { kind = 'fixed' }"}
    elastic = "\n".join(said(tmp_path / "a", "settings = { point = [10.0, 0.0] }", **held))
    assert "loaded with" not in elastic
    opened = 'mu = { low = "6 kPa", high = "20 kPa" }\nD1 = { value = 60 }\nprony_g = { low = 0.1, high = 0.5 }'
    lines = said(tmp_path / "b", 'settings = { point = [10.0, 0.0], speed = "6 mm/min" }', parameters=opened, **held)
    found = [line.strip() for line in lines if "loaded with" in line]
    assert found == ["loaded with 0.5 mm/s (assumed)", "loaded with 0.1 mm/s (as stated)"]
