"""A report in German: the same document with the same numbers, every sentence by its template."""

import html
import re
from collections import Counter

import pytest
import test_fitted_curve_drawn as fitted
from report_fixture import STAGES, complete, one_parameter, until

from fem_backend.closed_forms.formulas import formulas
from rso.report import render
from rso.report.calibration.numbers import report
from rso.report.language import in_language, languages, own_words, sentences_of

# Words that only English sentences have; names that a study gives are taken out before.
ENGLISH = """the of is are were with which and or not from than that this these those its each every where what how
by at for only into over under between after before most least lies value values measured simulated fitted depth force
curve error errors run runs target targets range data model best candidate candidates prediction predicted known unknown
determined interval surface likely readings noise""".split()


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """English and German page of one study, as text that a reader sees; and the German source."""
    folder, missing = tmp_path_factory.mktemp("pages"), []
    results = fitted.results()
    (english,) = render(results, folder, pdf=False)
    (german,) = render(results, folder, pdf=False, language="de", untranslated=missing)
    assert german.name == "report.de.html"
    assert missing == []
    source = german.read_text("utf-8")
    return seen(english.read_text("utf-8")), seen(source), source, results


def seen(page):
    page = re.sub(r'<div id="words" hidden>.*?</div>', "", page, flags=re.DOTALL)
    page = re.sub(r"<(style|script|metadata)\b.*?</\1>", "", page, flags=re.DOTALL)
    page = re.sub(r"<td[^>]*\bcode\b[^>]*>.*?</td>", "", page, flags=re.DOTALL)
    return html.unescape(re.sub(r"<[^>]+>", "\n", page)).replace("\u00a0", " ")


def numbers(text, comma):
    found = re.findall(rf"(?<![\w.,])\d+{re.escape(comma)}\d+(?!\w|\.\d)", text)
    return Counter(n.replace(comma, ".") for n in found)


def without_own(page, results):
    """A page without what a person has written: notes of data files, names, commands."""
    for note in sorted((n for e in results["experiments"] for n in e.get("notes") or ()), key=len, reverse=True):
        page = page.replace(note, " ")
    page = re.sub(r"(?m)^.*\b[a-z_]{3,} = .*$", " ", page)  # settings as a study file has them
    page = re.sub(r"rso run \S+.*|\S+\.csv", " ", page)
    for word in sorted((w for w in own_words(results) if re.search("[^\\W\\d]", w)), key=len, reverse=True):
        page = re.sub(rf"(?<![\w.]){re.escape(word)}(?![\w.]\w)", " ", page)
    return page


def test_both_languages_have_the_same_numbers(pages):
    english, german, _, results = pages
    a, b = numbers(without_own(english, results), "."), numbers(without_own(german, results), ",")
    assert sum(a.values()) > 500
    assert a == b


def test_no_english_is_left(pages):
    _, german, _, results = pages
    german = without_own(german, results)
    found = Counter(w for w in re.findall(r"[^\W\d_]+", german) if w in ENGLISH)
    assert not found, [(w, re.findall(rf".*\b{w}\b.*", german)[:2]) for w in found]


def test_the_page_says_which_language_it_is_in(pages):
    *_, source, _ = pages
    assert '<html lang="de">' in source
    for word in ("Eindringkörper", "Eindringtiefe", "Konfidenz", "Antwortfläche", "Likelihood-Quotient"):
        assert word in source


def test_what_the_script_says_is_german_too(pages):
    *_, source, _ = pages
    held = re.search(r'<div id="words" hidden>(.*?)</div>', source, re.DOTALL)[1]
    assert '"Copy table": "Tabelle kopieren"' in held
    assert len(re.findall(r"\bsay = ", source)) == 1  # a second one would hide it
    spoken = set(re.findall(r'say\("([^"]+)"\)', source))
    assert spoken and all(f'"{w}":' in held for w in spoken - {"line"} if w not in ("SVG",)), spoken


@pytest.mark.parametrize("results", [complete, one_parameter, *(lambda s=s: until(s) for s in STAGES)])
def test_every_sentence_of_every_stage_has_a_template(results):
    found = results()
    by = sentences_of("de", own_words(found))
    in_language(report(found), by)
    assert list(by.missing) == []


@pytest.mark.parametrize("language", languages())
def test_a_template_fills_the_slots_that_it_reads(language):
    for t in sentences_of(language).templates:
        read, filled = (set(re.findall(r"\{(\w+)!?\}", s)) for s in (t.english, t.other))
        assert filled == read, (t.topic, t.english)


def test_a_sentence_without_a_template_is_named_and_stays():
    by = sentences_of("de")
    assert by.text("Nobody has said this. All runs") == "Nobody has said this. Alle Rechnungen"
    assert list(by.missing) == ["Nobody has said this."]


def test_numbers_get_a_comma_and_versions_keep_their_points():
    by = sentences_of("de")
    assert by.numbers("1.5 N, rso 0.1.0, −0.003, a.2.csv, 3 mm") == "1,5 N, rso 0.1.0, −0,003, a.2.csv, 3 mm"


def test_another_language_is_refused_by_name():
    with pytest.raises(ValueError, match="en, de"):
        sentences_of("xx")


@pytest.mark.parametrize("shape", ["sphere", "flat", "cone"])
@pytest.mark.parametrize("base", ["bonded", "slip"])
@pytest.mark.parametrize("thickness", [None, 0.2, 2.0, 30.0])
def test_closed_forms_and_where_they_hold_have_templates(shape, base, thickness):
    by, at = sentences_of("de"), {"radius": 3.0, "fillet": 0.1, "half_angle": 60.0, "tip_radius": 0.5}
    texts = set()
    for nu in (0.3, 0.5):
        for f in formulas(shape, 1.0, nu, thickness=thickness, base=base, neo_hookean=True, **at):
            texts |= {f.name, f.source, *(f.valid(h) for h in (0.05, 0.5, 2.5))} - {None}
    assert len(texts) >= 2
    assert [t for t in texts if by.phrase(t) is None] == []
