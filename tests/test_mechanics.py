"""`rso` knows no mechanics: the words of it are in the backend, and what remains is listed with its reason."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NAMES = ("hertz", "jkr", "bowl", "prony", "yeoh", "ogden", "adhesion", "fem_backend")
WORDS = {  # a word → how it is found, in any case; parts of names count (by_hertz), parts of words do not (global)
    **{name: rf"(?<![a-z]){name}(?![a-z])" for name in NAMES},
    "ball": r"(?<![a-z])balls?(?![a-z])",
    "sphere": r"(?<![a-z])spher(es?|ical)(?![a-z])",
    "ellipsoid": r"ellipsoid",
    "semi-axes": r"semi[-_ ]ax[ei]s",
    "neo-Hooke": r"neo[-_ ]?hooke",
    "Mooney": r"mooney",
    "poroelastic": r"poro[-_ ]?elastic",
    "mu": r"([\"'`])mu\1|`mu\b|\bmu \*",
    "D1": r"(?<![a-z0-9])D1(?![a-z0-9])",
    "radius": r"[\"']radius[\"']",
}
LETTERS = "letters of the literature in print: any other name is printed as it is"
EXAMPLE = "an example of what somebody may write, in a docstring or a message"
KNOWN = "test functions with known answers from the literature, none used by a study"
MORRIS = "Morris's μ, the mean of elementary effects"
ALLOWED = {  # file → words, and why they may stand there
    "benchmarks.py": ("mooney sphere mu d1", KNOWN),
    "calibration/gauss_newton/descent_results.py": ("radius", "that of a trust region"),
    "calibration/sensitivity_stage.py": ("mu", MORRIS),
    "cli/checking.py": ("adhesion", "names the knob that a pulling force needs"),
    "contract/capabilities.py": ("hertz mu d1", "the name of a member that backends have; examples"),
    "core/default_backend.py": ("fem_backend", "the one place that names the backend"),
    "data/contact_point.py": ("adhesion jkr", "assumptions of a contact found by the shape of the force"),
    "data/plausibility.py": ("adhesion", "names the knob that a pulling force needs"),
    "discrepancy/wording.py": ("poroelastic", "a cause that no model has and a knob looks like"),
    "doe/constraints.py": ("mu d1", EXAMPLE),
    "inference/usual_errors.py": ("adhesion", "names the knob that a pulling force needs"),
    "inference/sloppy_directions.py": ("mu d1", EXAMPLE),
    "report/calibration/influence.py": ("mu", MORRIS),
    "report/layout/digits.py": ("d1", LETTERS),
    "report/reading.py": ("d1", LETTERS),
    "study/cases.py": ("hertz radius", "asks for `hertz`; compares a depth with `indenter.radius` where it is stated"),
    "study/errors.py": ("mu d1", EXAMPLE),
    "study/loader.py": ("adhesion", "the knob of a model that follows a pull into contact"),
    "study/schema.py": ("mu d1", EXAMPLE),
}


def words_of(text):
    """The words of mechanics in a text, in small letters."""
    return {word.lower() for word, pattern in WORDS.items() if re.search(pattern, text, re.IGNORECASE)}


def test_rso_knows_no_mechanics():
    found = {str(p.relative_to(ROOT / "rso")): words_of(p.read_text("utf-8")) for p in (ROOT / "rso").rglob("*.py")}
    allowed = {path: set(words.split()) for path, (words, _) in ALLOWED.items()}
    more = {path: left for path, words in found.items() if (left := words - allowed.get(path, set()))}
    assert more == {}  # move it into the backend, behind a capability of rso/contract/capabilities.py
    less = {path: gone for path, words in allowed.items() if (gone := words - found.get(path, set()))}
    assert less == {}  # no longer there: take it from the list


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("def by_hertz(u): ...", "hertz"),
        ('settings = {"shape": "ellipsoid"}', "ellipsoid"),
        ("the ball goes deeper", "ball"),
        ("of_balls = 1", "ball"),
        ('{"shape": "sphere"}', "sphere"),
        ("law = 'neo_hookean'", "neo-hooke"),
        ("neo-Hooke", "neo-hooke"),
        ('values["mu"]', "mu"),
        ("mu * D1 <= 3", "d1"),
        ("import fem_backend", "fem_backend"),
        ("semi_axes", "semi-axes"),
        ('indenter["radius"]', "radius"),
        ("poroelasticity", "poroelastic"),
    ],
)
def test_a_word_of_mechanics_is_caught(text, word):
    assert word in words_of(text)


def test_words_that_hold_others_are_none():
    assert words_of("global, ballast, atmosphere, mu_star, radius of a circle, D10, an adhesive? rebowled") == set()
