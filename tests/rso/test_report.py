import copy
import dataclasses
import html
import io
import json
import re
import shutil
import subprocess
import time
from contextlib import contextmanager
from functools import cache

import matplotlib.image
import numpy as np
import pytest
from report_fixture import STAGES, complete, one_parameter, until

from rso.core.curves import baseline
from rso.core.digits import rounded, significant
from rso.report import render
from rso.report.calibration import predictive_check
from rso.report.calibration.figures import draw
from rso.report.calibration.numbers import report
from rso.report.layout.digits import aligned, between, duration, percent, shown, symbol, unit_text
from rso.report.layout.document import Answers, Picture, Table, Text
from rso.report.layout.page import html_page, pdf_page, pour
from rso.report.notes import opening, sentences
from rso.report.reading import about_zero, lettered

NASTY = (
    r"""<script>alert("1")</script> & 'x' #panic("no") $\frac{1}{0}$ _a_ *b* @cite \ `raw` [c] {{ 7*7 }} // no ~ <l>"""
)


def texts(document):
    """Every string of a document, figures aside."""
    found = [document.title, document.subtitle, document.byline]
    for section in document.sections:
        found.append(section.title)
        for b in section.blocks:
            if isinstance(b, Table):
                found += [b.title, b.note, *(c.title for c in b.columns), *(c.unit for c in b.columns)]
                found += [cell.text for row in b.rows for cell in row]
            elif isinstance(b, Text):
                found.append(b.text)
            elif isinstance(b, Picture):
                found.append(b.caption)
            else:
                found += [t for f in b.facts for t in (f.label, f.value, f.note)]
    return found


def pictures(document):
    return [b.name for s in document.sections for b in s.blocks if isinstance(b, Picture)]


def everything(results):
    """What a reader can see: texts, and the geometry of the figures."""
    document = report(results)
    return texts(document), [draw(results, name) for name in pictures(document)]


def page(results):
    """Visible text of the HTML page, entities resolved, hidden spacing and figures removed."""
    document = report(results)
    source = html_page(document, {name: "" for name in pictures(document)})
    return html.unescape(re.sub(r"<[^>]*>", " ", source[source.index("<body>") :])).replace("\xa0", " ")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "new" / "folder"
    start = time.process_time()
    files = render(complete(), folder)
    return files, time.process_time() - start


def test_files_are_self_contained_small_and_quick(written):
    files, cpu = written
    assert [f.name for f in files] == ["report.html", "report.pdf"]
    assert sorted(p.name for p in files[0].parent.iterdir()) == ["report.html", "report.pdf"]
    source = files[0].read_text(encoding="utf-8")
    assert len(source) < 3e6 and cpu < 15
    # Nothing is loaded: the only addresses are names of XML namespaces.
    assert set(re.findall(r"""https?://[^"'\s>]+""", source)) <= {
        "http://www.w3.org/2000/svg",
        "http://www.w3.org/1999/xlink",
    }
    assert not re.search(r"<script\s|<link|<img|@import|url\((?!#)", source) and source.count("<script>") == 1
    ids = re.findall(r'\bid="([^"]+)"', source)
    assert len(ids) == len(set(ids))  # several figures in one page must not answer to the same name
    assert set(re.findall(r'href="#([^"]+)"', source)) | set(re.findall(r"url\(#([^)]+)\)", source)) <= set(ids)
    assert files[1].read_bytes().startswith(b"%PDF-")


def test_only_what_is_asked_for_is_written(tmp_path):
    assert [f.name for f in render(until("plan"), tmp_path, pdf=False)] == ["report.html"]
    assert [f.name for f in render(until("plan"), tmp_path / "b", html=False)] == ["report.pdf"]


def test_same_results_same_bytes_whatever_the_users_settings(written, tmp_path):
    with matplotlib.rc_context({"font.size": 30, "axes.grid": True, "svg.fonttype": "none", "text.parse_math": True}):
        again = render(complete(), tmp_path)
        assert matplotlib.rcParams["font.size"] == 30
    for a, b in zip(written[0], again, strict=True):
        assert a.read_bytes() == b.read_bytes(), a.name
    changed = complete()
    changed["study"]["title"] += "."  # negative control
    assert report(changed) != report(complete())


def test_the_verdict_answers_first():
    first = report(complete()).sections[0]
    lead = next(b.text for b in first.blocks if isinstance(b, Text)).replace("\xa0", " ")
    assert lead == "μ is 10.2 kPa, with 90 % confidence between 8.8 and 12.6 kPa."
    (lines,) = (b.facts for b in first.blocks if isinstance(b, Answers))
    assert [(f.label, f.mark) for f in lines] == [("Known", "good"), ("Not known", "warn"), ("Prediction", "bad")]
    main = [s.id for s in report(complete()).sections if not s.appendix]
    assert main == ["verdict", "curves", "prediction", "open", "model"]
    said = page(complete())
    assert "μ is determined: 10.2 kPa (0.0102 MPa), and with 90 % confidence anything from 8.8 to 12.6 kPa" in said
    assert "D₁ is not determined: with 90 % confidence every value from 1.09 to 160 MPa⁻¹ (a factor of 150)" in said
    assert "D₁ goes from 6.20 MPa⁻¹ to 139 MPa⁻¹" in said
    assert "13 of 15 candidates are verified" in said and "Not within the tolerance: 3P 2" in said
    assert "1P FR 3 (failed)" in said
    assert "NRMSE of 2.8 % (RMSE 6.56 mN). For scale: a flat line at the mean force has 71 %" in said
    assert "No: force_8mm, which was not used for the fit, is not predicted: at 8 mm 1.283 N was measured" in said
    assert "and the best candidate has 1.356 N; 5.2 to 11 % too high over all 13 candidates." in said
    assert "49 simulations (3 failed, 1 crashed) and 6 min 1 s of wall time" in said
    assert "widen the range of μ" in said and "Over the whole interval of D₁ the force" in said


@pytest.mark.parametrize(("scale", "p"), [(1.8, 1e-6), (7.6, None)])
def test_a_refuted_model_agrees_with_nothing(scale, p):
    results = complete()
    results["identification"] |= {"scale": scale, "p_value": p}
    said = page(results).replace("\xa0", " ")
    assert f"(a factor of 150) fits as well as any under the model, which misses the data by {scale} times" in said
    assert "the model misses the data" in said and "agree with the data" not in said
    assert "agrees with the data" in page(complete()).replace("\xa0", " ")  # the control


def test_two_pieces_of_a_profile_are_said_and_drawn_as_two():
    results = complete()
    before = draw(results, "determined")
    d1 = results["identification"]["parameters"][1]
    D1 = np.array(d1["profile"]["values"])
    d1["profile"]["rise"] = list(4 * (np.log(D1 / 13) ** 2 - 4) ** 2)  # valleys at 1.76 and at 96 1/MPa
    text = page(results).replace("\xa0", " ")
    assert "every value from 1.48 to 2.20 MPa⁻¹ or 77 to 117 MPa⁻¹ agrees with the data" in text
    assert "every value from 1.09 to 160 MPa⁻¹ (a factor of 150)" not in text
    assert draw(results, "determined") != before


def test_a_design_that_similarity_replaced_is_not_said_to_have_been_run():
    results = complete()
    assert "so 26 other points were run instead of its points" in page(results)
    results["design"]["similarity"]["applied"] = False
    assert "instead of its points" not in page(results)


def test_every_candidate_run_and_metric_is_on_the_page():
    results, text = complete(), page(complete())
    for s in results["searches"]:
        assert f"Search {s['name']}" in text and lettered(results, s["story"]) in text
    for r in results["runs"]:
        assert r["key"][:8] in text
        assert r["reason"] is None or r["reason"] in text
    for word in ("failed: inversion", "failed: contact", "crashed", "not verified", "mean over all design runs"):
        assert word in text
    for e in results["experiments"]:
        assert all(note in text for note in e["notes"])
    for value in (
        *results["provenance"]["data_sha256"].values(),
        results["provenance"]["command"],
        "scikit-learn 1.7.2",
    ):
        assert value in text


def leaves(data, path=()):
    """(path, number) of one example of every kind of number: of a list only its first element."""
    if isinstance(data, dict):
        for k, v in data.items():
            yield from leaves(v, (*path, k))
    elif isinstance(data, list) and data:
        yield from leaves(data[0], (*path, 0))
    elif isinstance(data, float) or (isinstance(data, int) and not isinstance(data, bool)):
        yield path, data


# Read by machines only, or shown in another form: the layout's version; CPU time of one run; the metrics of one
# candidate carry the number of points for all; a validation shows the difference and the NRMSE of its metrics; the
# change along a profile is in the sentence of its reason; the largest numerical error stands for all (here every one is
# 0.4 %); a surrogate's RMSE is given in units; along a curve the total index and the elasticity are drawn; what
# constraints exclude is in the story.
SILENT = re.compile(
    r"schema|cpu_s|(baseline|mean_over_runs).*\.(n|excluded)$|validation.*metrics.(rmse|mre|mape|rrmse|n|excluded)|"
    r"surrogates.*cross_validation\.n$|relative_rmse|along.*\.(low|high|change|first|first_interval\.0)$|excluded$|"
    r"profile\.(change|sigma)"
)


# Where a number is drawn, to look there first.
DRAWN = {"sensitivity.curves": "shapes", "along": "along", "morris": "morris", "profile": "profile"}
DRAWN |= {"measured": "curve", "targets": "surface", "outputs": "verification"}
DRAWN |= {k: k for k in ("surface", "front", "curve", "validation")}


@contextmanager
def changed(results, path):
    """The study with one number changed, for as long as it is looked at."""
    place = results
    for key in path[:-1]:
        place = place[key]
    value = place[path[-1]]
    place[path[-1]] = value + 1 if isinstance(value, int) else value * 1.25 + 0.013
    yield
    place[path[-1]] = value


def test_every_number_is_taken_from_the_results():
    results = complete()
    document = report(results)
    base_text, names = texts(document), pictures(document)
    figure = cache(lambda name: draw(complete(), name))
    paths = [path for path, _ in leaves(results)]
    assert len(paths) > 100
    quiet = []
    for path in [p for p in paths if not SILENT.search(".".join(map(str, p)))]:
        with changed(results, path):
            if texts(report(results)) == base_text:
                quiet.append(path)
    assert results == complete()
    # What no text shows must move a figure.
    assert quiet and len(quiet) < 24
    for path in quiet:
        place = ".".join(map(str, path))
        kind = next((figure for part, figure in DRAWN.items() if part in place), "")
        likely = sorted(names, key=lambda name: not name.startswith(kind))
        with changed(results, path):
            assert any(draw(results, name) != figure(name) for name in likely), path


def scaled(data, k):
    """The same data with every float larger by 5 to 22 %, each by another share; `k` counts them."""
    if isinstance(data, dict):
        return {a: scaled(b, k) for a, b in data.items()}
    if isinstance(data, list):
        return [scaled(b, k) for b in data]
    if isinstance(data, float):
        k.append(0)
        return data * (1.05 + 0.17 * np.sin(1.7 * len(k)) ** 2)
    return data


def columns(results):
    """(table, column) → texts of its cells, for the tables of the answers."""
    tables = [b for s in report(results).sections[1:9] for b in s.blocks if isinstance(b, Table)]
    return {(t.title, k): [row[k].text for row in t.rows] for t in tables for k in range(len(t.columns))}


def test_no_number_of_a_table_is_written_into_the_code():
    first, second = columns(complete()), columns(scaled(complete(), []))
    measured = [key for key, cells in first.items() if any(re.search(r"\d\.\d\d", c) for c in cells)]
    assert len(measured) > 40
    for key in measured:
        pairs = [(a, b) for a, b in zip(first[key], second[key], strict=True) if re.fullmatch(r"[+−]?[\d.]+", a)]
        # Three digits of two numbers meet by chance now and then.
        assert sum(a == b for a, b in pairs) <= 0.35 * len(pairs), (key, pairs)


def test_a_dollar_sign_in_a_name_is_no_formula():
    results = complete()
    results["experiments"][0]["channel"] = "$\\nosuchcommand$"
    assert draw(results, "curve-0").startswith("<svg")


def test_no_number_has_more_digits_than_anyone_can_use():
    stray = complete()
    stray["runs"][0]["values"]["mu"] = 1 / 3 * 1e-2
    stray["searches"][0]["candidates"][0]["agreement"] = 1 / 7
    text = page(stray)
    text = re.sub(r"\b[0-9a-f]{8,}\b", "", text)
    assert not re.findall(r"\d\.\d{7,}", text)
    assert not re.search(r"\b(nan|None|inf)\b", text)


def nasty():
    results = complete()
    results["study"]["title"] = NASTY
    results["warnings"] = [NASTY]
    results["provenance"]["command"] = NASTY
    results["backend"]["settings"]["note"] = NASTY
    results["parameters"][0]["description"] = NASTY
    results["experiments"][0]["notes"] = [NASTY]
    results["experiments"][0]["name"] = results["searches"][0]["name"] = NASTY
    results["runs"][7]["reason"] = NASTY
    results["searches"][0]["story"] = results["determined"]["D1"]["story"] = NASTY
    for o in results["outputs"]:
        o["channel"] = NASTY
    for c in results["searches"][0]["candidates"]:
        c["curves"] = {NASTY: c["curves"]["middle_point"]}
        c["metrics"] = {NASTY: c["metrics"]["middle_point"]}
    results["best"] = {"search": NASTY, "candidate": "1"}
    return results


def test_text_of_other_people_stays_text(tmp_path):
    files = render(nasty(), tmp_path)
    source = files[0].read_text(encoding="utf-8")
    assert source.count("<script") == 1 and source.count("</script") == 1
    assert "<l>" not in source and source.count(html.escape("<script>")) >= 8
    assert NASTY in html.unescape(source)
    assert "{{ 7*7 }}" in source and "49*" not in source
    if shutil.which("pdftotext") is None:
        pytest.skip("pdftotext is not installed; that the PDF compiles at all shows that #panic was not run")
    read = subprocess.run(["pdftotext", "-layout", files[1], "-"], capture_output=True, text=True, check=True).stdout
    flat = re.sub(r"\s+", "", read)
    for piece in NASTY.split():
        assert flat.count(piece) >= 6, piece
    assert re.sub(r"\s+", "", NASTY) in flat


def test_a_template_that_ran_text_would_be_noticed():
    document = report(nasty())
    with pytest.raises(Exception, match="no"):  # negative control: typst itself does run it
        import typst

        typst.compile(b'#panic("no")')
    assert pdf_page(report({}), {}).startswith(b"%PDF") and document.title == NASTY


def test_control_characters_and_lone_surrogates_reach_neither_page(tmp_path):
    results = until("plan")
    results["study"]["title"] = "a\x00b\x1bc\ud800d"
    files = render(results, tmp_path)
    assert "a�b�c�d" in files[0].read_text(encoding="utf-8")


@pytest.mark.parametrize("stage", STAGES[:-1])
def test_every_stage_renders_and_says_what_is_missing(stage, tmp_path):
    results = until(stage)
    document = report(results)
    said = " ".join(texts(document))
    later = STAGES[STAGES.index(stage) + 1 :]
    assert "not complete" in said and "not complete" not in " ".join(texts(report(complete())))
    assert f"“{stage}”" in said and ", ".join(later) in said
    figures = {name: draw(results, name) for name in pictures(document)}
    assert len(html_page(document, figures)) > 5000
    assert pdf_page(document, figures).startswith(b"%PDF")


def test_no_page_on_paper_is_a_third_empty(monkeypatch):
    """A picture without room on its page goes to the next one, and what follows it fills the first."""
    import typst

    make, pages = typst.compile, []

    def both(source, **given):
        drawn = make(source, **{**given, "format": "png", "ppi": 30})
        pages.extend(matplotlib.image.imread(io.BytesIO(page), format="png")[..., :3].min(axis=2) for page in drawn)
        return make(source, **given)

    monkeypatch.setattr(typst, "compile", both)
    document = report(complete())
    pdf_page(document, {name: draw(complete(), name) for name in pictures(document)})
    down = [np.nonzero((page < 0.8).any(axis=1))[0].max() / len(page) for page in pages]
    assert len(pages) > 5 and min(down[:-1]) > 2 / 3


def test_nothing_at_all_still_renders(tmp_path):
    for results in ({}, {"stage": "later"}, {k: None for k in complete()}):
        assert len(render(results, tmp_path)) == 2
        assert "has not finished any stage" in page(results)


def test_one_parameter_gives_a_line_and_no_surface():
    results = one_parameter()
    text, figures = page(results), everything(results)[1]
    assert len(figures) > 8
    assert "Band: the surrogate’s own error" in text and "Accent line" not in text


def drop(data, chance, rng):
    """The same data with some numbers unknown."""
    if isinstance(data, dict):
        return {k: drop(v, chance, rng) for k, v in data.items()}
    if isinstance(data, list):
        return [drop(v, chance, rng) for v in data]
    return None if isinstance(data, float) and rng.random() < chance else data


@pytest.mark.parametrize("chance", [0.05, 0.5, 1.0])
def test_unknown_numbers_are_dashes_not_errors(chance):
    results = drop(complete(), chance, np.random.default_rng(3))
    texts_, figures = everything(results)
    assert figures and not any(re.search(r"\b(nan|None|inf)\b", t) for t in texts_)


def test_a_simulation_that_ends_before_the_first_reading_is_said_to():
    results = complete()
    for s in results["searches"]:
        for c in s["candidates"]:
            for curve in c["curves"].values():
                curve |= {k: v[:3] for k, v in curve.items() if isinstance(v, list)}
    e = results["experiments"][0]
    e["measured"] = {k: v[20:] for k, v in e["measured"].items()}
    assert "ends before the first of them" in page(results)
    assert "<svg" in draw(results, "curve-0")


def test_curve_validation_many_parameters_and_other_shapes():
    results = complete()
    for v in results["validation"]:
        if v["state"] == "done":
            v.update(depth=[2.0, 5.0, 8.0], measured=[0.2, 0.7, 1.283], sigma=[0.01] * 3, predicted=[0.21, 0.72, 1.3])
    results["experiments"][1]["measured"] = {"depth": [2.0, 5.0, 8.0], "value": [0.2, 0.7, 1.283], "sigma": None}
    extra = {**results["parameters"][0], "name": "skin_stiffness", "unit": "MPa", "low": 0.2, "high": 2.0, "log": False}
    results["parameters"].append(extra)
    results["searches"][0]["kind"] = "islands"
    for s in results["surfaces"]:
        s["others"] = {"skin_stiffness": 0.7}
    text, figures = page(results), everything(results)[1]
    assert "skin_stiffness = 0.7000 MPa" in text and "separate solutions" in text and len(figures) > 8


SHAPE = np.array([-0.1, -0.3, -0.6, -0.3, -0.1])  # of a profile of five marks, in mm at 4 mm
OFF = 0.01 * np.array([1.0, -1.0, 3.0, 1.0, -1.0])


def with_profile(role="validate", turned=False):
    """The study with a profile of five marks at two depths; every candidate is off by OFF mm at the deeper one."""
    results = complete()
    place = [[0.0, float(x)] if turned else [float(x), 5.0] for x in (-20, -10, 0, 10, 20)] * 2
    depth, value = [2.0] * 5 + [4.0] * 5, np.concatenate([0.5 * SHAPE, SHAPE])
    predicted, sigma = value + np.concatenate([0 * OFF, OFF]), [0.012] * 10
    kind = {"name": "surface", "role": role, "kind": "profile", "channel": "uz", "unit": "mm", "settings": {}}
    data = {"depth": depth, "value": value.tolist(), "sigma": sigma, "position": place}
    results["experiments"].append({**kind, "file": "p.csv", "notes": ["Not used."], "n_repeats": 1, "measured": data})
    if role == "validate":
        first = next(v for v in results["validation"] if v["state"] == "done")
        scores = {"rmse": 0.0114, "nrmse": 0.0543, "mre": 0.1, "mape": 10.0, "rrmse": 0.1, "n": 10, "excluded": 0}
        for v in [v for v in results["validation"] if v["experiment"] == first["experiment"]]:
            mine = {**v, "experiment": "surface", "depth": depth, "measured": value.tolist(), "sigma": sigma}
            mine |= {"position": place, "predicted": predicted.tolist() if v["state"] == "done" else []}
            results["validation"].insert(0, {**mine, "metrics": scores if v["state"] == "done" else None})
    return results


def table_of(results, title):
    tables = [b for s in report(results).sections for b in s.blocks if isinstance(b, Table)]
    found = next(t for t in tables if t.title == title)
    return {c.title: [row[k].text for row in found.rows] for k, c in enumerate(found.columns)}


def fact(results, label):
    found = [f for b in report(results).sections[0].blocks if hasattr(b, "facts") for f in b.facts]
    return next(f for f in found if f.label == label)


def test_a_profile_for_validation_is_compared_mark_by_mark():
    results = with_profile()
    text = page(results)
    said = "Yes: surface, which was not used for the fit, is predicted: 10 displacements with an RMSE of 11.4 µm (5.4 %"
    assert said in text
    assert "as main 1 predicts it: off by at most 30 µm ((0, 5) at 4 mm). 9 of 10 marks lie within 2σ" in text
    t = table_of(results, "Unused test surface")
    rows = [k for k, state in enumerate(t[""]) if state == "done"]
    assert rows and {t["marks"][k] for k in rows} == {"10"} and {t["where"][k] for k in rows} == {"(0, 5) at 4 mm"}
    assert {t["largest"][k] for k in rows} == {"−30.0"} and {t["RMSE"][k] for k in rows} == {"11.4"}
    # The fact on the first page counts both tests, and curves and their figures are as they were.
    assert fact(results, "Unused tests").value == "1 of 2 predicted"
    assert pictures(report(results)) == [
        n for p in pictures(report(complete())) for n in ([p, "validation-1"] if p == "validation-0" else [p])
    ]
    assert draw(results, "curve-0") == draw(complete(), "curve-0")


def test_the_figure_of_a_profile_holds_its_numbers():
    drawn = draw(with_profile(), "validation-1")
    assert drawn != draw(with_profile(turned=True), "validation-1")
    for key in ("measured", "predicted", "sigma"):
        moved = with_profile()
        for v in moved["validation"]:
            if v["experiment"] == "surface" and v[key]:
                v[key][3] += 0.05
        assert draw(moved, "validation-1") != drawn, key
    lost = with_profile()
    for v in lost["validation"]:
        v.update(state="failed", cause="contact", reason="no end", predicted=[], metrics=None)
    assert "validation-1" not in pictures(report(lost)) and "failed: contact" in page(lost)
    many = with_profile()
    for v in many["validation"]:
        if v["experiment"] == "surface":
            v["depth"] = np.linspace(0.1, 4, 10).tolist()  # one depth a mark
    assert draw(many, "validation-1").startswith("<svg")


def test_what_of_the_data_is_not_used_is_said_in_the_list_of_experiments():
    results = with_profile("fit")
    results["experiments"][0]["settings"]["unload"] = True
    data = table_of(results, "Data")
    assert data["channel"] == ["Fz, loading", "Fz", "uz, profile, not used"]
    assert "surface: Not used." in page(results)
    assert report(results).subtitle == report(complete()).subtitle
    assert pictures(report(results)) == pictures(report(complete()))


def test_a_thousand_runs_stay_readable(tmp_path):
    results = complete()
    results["runs"] = [copy.deepcopy(results["runs"][k % 30]) for k in range(1000)]
    start = time.process_time()
    files = render(results, tmp_path)
    assert time.process_time() - start < 15 and files[0].stat().st_size < 3e6


@pytest.mark.parametrize(
    "x,half,text",
    [
        (10.17, 1.9, "10.2"),
        (10.17, 0.04, "10.170"),
        (10.17, 30.0, "10"),
        (1234.0, 200.0, "1230"),
        (9.996, 0.3, "10.00"),
    ],
)
def test_digits_follow_the_uncertainty(x, half, text):
    assert rounded(x, half) == text


def test_numbers_and_units_as_people_write_them():
    assert significant(0.0033560001) == "0.003356" and significant(9.99996) == "10.00"
    assert significant(-1.5, 2) == "−1.5" and significant(None) == "–" and significant(float("nan")) == "–"
    assert significant(1.234e-9) == "1.234\xa0×\xa010⁻⁹" and significant(0) == "0"
    assert percent(1e-9) == "<\xa00.001\xa0%" and percent(0.0339) == "3.4\xa0%"
    assert shown("MPa", 0.036).label == "kPa" and shown("MPa", 2e-5).label == "Pa" and shown("MPa", 0.5).label == "MPa"
    assert shown("N", 0.03).label == "mN" and shown("N", 0.5).label == "N" and shown("1/MPa", 5).label == "MPa⁻¹"
    assert symbol("mu") == "μ" and symbol("D1") == "D₁" and symbol("C10") == "C₁₀" and symbol("skin") == "skin"
    assert unit_text("1") == "" and unit_text("1/MPa") == "MPa⁻¹"
    assert (
        duration(252) == "4\xa0min\xa012\xa0s"
        and duration(8.4) == "8.4\xa0s"
        and duration(12000) == "3\xa0h\xa020\xa0min"
    )
    assert between(0.00884, 0.01263, shown("MPa", 0.0367)) == "8.8 to 12.6\xa0kPa"


@pytest.mark.parametrize(
    "values", [[1.1, 159.683, 5.8], [0.0339, 0.6835, 0.034], [3.0, 250000.0], [12.0, 3456.0, None]]
)
def test_decimal_points_stand_below_each_other(values):
    cells = [c for c in aligned(values) if c.text != "–"]
    behind = {len((c.text + c.pad).partition(".")[2]) for c in cells}
    assert len(behind) == 1
    for c, v in zip(cells, values, strict=False):
        # Four digits of the largest number, or of each.
        np.testing.assert_allclose(float(c.text), v, atol=0.5 * 10.0 ** -len(c.text.partition(".")[2]), rtol=5e-4)


def test_colour_is_never_the_only_sign(written):
    source = written[0][0].read_text(encoding="utf-8")
    assert re.search(r'class="bad k">failed', source) and re.search(r'class="warn k">not verified', source)
    with pytest.raises(ValueError, match="no figure"):
        draw(complete(), "unknown")


def test_a_curve_of_few_travels_is_compared_as_its_metrics_are():
    """Between eight travels the force is no straight line: residuals are those of the curve that is scored."""
    results = complete()
    measured = next(e for e in results["experiments"] if e["name"] == "middle_point")["measured"]
    best = next(c for s in results["searches"] for c in s["candidates"] if c["name"] == results["best"]["candidate"])
    curve, depth = best["curves"]["middle_point"], np.array(measured["depth"])
    few = np.array(curve["depth"])
    curve["value"] = (0.07 * few**1.5).tolist()
    measured.update(value=(0.07 * depth**1.5).tolist(), sigma=np.full(len(depth), 1e-4).tolist())
    caption = next(t for t in texts(report(results)) if "deviates from the measurement" in t)
    assert re.search(r"at most [\d.]+\s×\s10⁻[⁴⁵⁶⁷⁸⁹]\snN", caption)
    straight = np.abs(np.interp(depth, few, curve["value"]) - measured["value"])[depth >= few[0]]
    assert straight.max() > 2e-4  # negative control: straight lines would not


def caption(results, name):
    return next(b.caption for s in report(results).sections for b in s.blocks if getattr(b, "name", None) == name)


def test_the_range_is_said_as_the_verdict_is():
    """A weakly determined parameter is not "almost anywhere", and no letter becomes a capital."""
    results = complete()
    assert "the data leave D₁ open over half of the range and more" in caption(results, "determined")
    for p in results["identification"]["parameters"]:
        p["verdict"] = "weakly"
    for d in results["determined"].values():
        d["determined"] = False
    assert caption(results, "determined").startswith("The data narrow μ and D₁ down, but not to a value.")
    drawn = draw(results, "determined")
    results["identification"]["parameters"][1]["verdict"] = "not"
    assert draw(results, "determined") != drawn


def test_curves_that_only_choose_are_not_called_the_source_of_the_parameters():
    results = complete()
    assert report(results).subtitle == "Parameters identified from middle_point"
    results["experiments"].append({**copy.deepcopy(results["experiments"][0]), "name": "aside", "role": "select"})
    assert report(results).subtitle == "Parameters identified from middle_point, chosen with aside too"


def test_runs_saved_are_points_of_the_design_and_simulations():
    results = complete()
    saved = results["design"]["similarity"]["runs_saved"]
    results["counts"]["saved_by_similarity"] = 2 * saved
    assert f"Exact similarity saved {saved} of all these, {2 * saved} simulations." in page(results)
    results["counts"]["saved_by_similarity"] = saved
    assert f"Exact similarity saved {saved} of all these." in page(results)


def test_targets_of_several_experiments_are_told_apart_in_the_front(monkeypatch):
    results, said = complete(), []
    k, s = next((k, s) for k, s in enumerate(results["searches"]) if len(s["targets"]) == 2)
    monkeypatch.setattr(matplotlib.axes.Axes, "set_ylabel", lambda self, text, **_: said.append(text))
    draw(results, f"front-{k}")
    assert "|ΔFz| at 3.9 mm (mN)" in said
    s["targets"][1] = {**s["targets"][1], "experiment": "aside"}
    draw(results, f"front-{k}")
    assert "|ΔFz| of aside at 3.9 mm (mN)" in said
    one = next(s for s in results["searches"] if len(s["targets"]) == 1)
    one["front"] = {key: v[:1] for key, v in one["front"].items()}
    assert "one target, met best at μ" in page(results)


def test_comment_lines_of_a_file_are_read_as_the_sentences_that_they_were():
    lines = ["Not a record: the force was read off a figure of the source, with its", "axes. Sent by J. Doe"]
    assert sentences(lines) == [
        "Not a record: the force was read off a figure of the source, with its axes.",
        "Sent by J. Doe.",
    ]
    assert sentences(["Operator: JD", "Machine: Zwick 2.5"]) == ["Operator: JD.", "Machine: Zwick 2.5."]
    assert opening(["One. Two.", "Three is far too long for it."], 20) == "One. Two."
    assert opening(["One that is too long for it."], 5) == "One that is too long for it."


def test_what_a_data_file_says_of_itself_stands_under_the_answer():
    results = complete()
    results["experiments"][0].update(file="m.csv", notes=["Only loading is used.", "A copy", "of a copy."], remarks=1)
    results["experiments"][1].update(file="n.csv", notes=["A copy of a copy."])
    first = report(results).sections[0].blocks
    assert [b.text for b in first if isinstance(b, Text) and b.role == "remark"] == ["m.csv, n.csv: A copy of a copy."]
    assert "Of the data. m.csv, n.csv: A copy of a copy." in re.sub(r"\s+", " ", page(results))
    results["experiments"][0].update(notes=["Only loading is used."])
    results["experiments"][1].update(notes=[])
    assert not [b for b in report(results).sections[0].blocks if isinstance(b, Text) and b.role == "remark"]


def test_whether_an_unused_test_is_predicted_is_yes_or_no():
    """All candidates agree with what was fitted: a test among their predictions is predicted, and tells them apart."""
    results = complete()
    assert fact(results, "Unused test").value == "not predicted" and fact(results, "Unused test").mark == "warn"
    assert "over all 13 candidates; uncertainty 1.0\xa0%" in fact(results, "Unused test").note
    done = [v for v in results["validation"] if v["state"] == "done"]
    for v in done:
        v["numerical_error"] = [0.13]  # of the simulation: 10 %
    assert fact(results, "Unused test").value == "predicted" and fact(results, "Unused test").mark == "good"
    assert "Yes: force_8mm" in page(results) and "of measurement and computation together is 10 %" in page(results)
    done[-1]["predicted"] = [1.8]
    assert fact(results, "Unused test").value == "within what is open"
    assert f"lies among the predictions of {len(done)} candidates, {len(done) - 1} of which meet it" in page(results)
    for v in done:
        v["predicted"] = [1.8]
    assert fact(results, "Unused test").value == "not predicted"
    for v in done:
        v.update(sigma=[None], numerical_error=[])
    assert fact(results, "Unused test").value == "compared" and "no known uncertainty" in page(results)


def test_residuals_are_measured_less_simulated(monkeypatch):
    results, drawn = complete(), []
    best = next(c for s in results["searches"] for c in s["candidates"] if c["name"] == results["best"]["candidate"])
    best["curves"]["middle_point"]["value"] = [0.0] * len(best["curves"]["middle_point"]["depth"])
    plot = matplotlib.axes.Axes.plot
    monkeypatch.setattr(matplotlib.axes.Axes, "plot", lambda self, *a, **k: drawn.append((a, k)) or plot(self, *a, **k))
    said = []
    label = matplotlib.axes.Axes.set_ylabel
    monkeypatch.setattr(matplotlib.axes.Axes, "set_ylabel", lambda self, t, **k: said.append(t) or label(self, t, **k))
    draw(results, "curve-0")
    assert any("measured −" in t for t in said)
    last = drawn[-1][0]
    assert last[1].max() > 0 and last[1].min() >= 0  # nothing is simulated: all of the force is left


DIAGNOSIS = {
    "verdict": "explained",
    "where": [
        {"experiment": "middle_point", "channel": "Fz", "region": "2 to 3 mm", "z": -4.21, "beyond_noise": True},
        {"experiment": "middle_point", "channel": "Fz", "region": "3 to 4 mm", "z": 0.4, "beyond_noise": False},
    ],
    "causes": [
        {
            "effect": "skin",
            "description": "a stiffer skin",
            "probability": 0.97,
            "size": 0.31,
            "interval": [0.22, 0.41],
            "unit": "mm",
            "neutral": 0.0,
        }
    ],
    "shrinkage": {"closed": 0.83, "held_out": ["force_8mm"]},
}


def test_where_the_model_is_off_is_told_or_that_nobody_has_looked(tmp_path, monkeypatch):
    monkeypatch.setattr("rso.report.calibration.report.draw", lambda results, name: "<svg/>")  # words alone are read
    assert "has not been examined; “rso diagnose STUDY” does." in page(complete())
    results = complete() | {"diagnosis": DIAGNOSIS}
    text = page(results)
    assert "not been examined" not in text and fact(results, "Gap to reality").value == "explained"
    assert "The cause closes 83 % of the gap on force_8mm." in text
    assert "Fz of middle_point, 2 to 3 mm (measured below simulated, 4.2 standard" in text
    assert "3 to 4 mm (measured" not in text
    assert table_of(results, "Causes")["Cause"] == ["a stiffer skin"]
    (tmp_path / "diagnosis.json").write_text(json.dumps({"diagnosis": DIAGNOSIS}), encoding="utf-8")
    render(complete(), tmp_path, pdf=False)
    source = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "a stiffer skin" in source and '<a href="diagnosis.html">diagnosis.html</a></p>' in source
    (tmp_path / "diagnosis.json").write_text("{", encoding="utf-8")  # half written: as if there were none
    render(complete(), tmp_path, pdf=False)
    assert "not been examined" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_pages_of_one_folder_lead_to_each_other(tmp_path):
    render(until("plan"), tmp_path, pdf=False)
    first = tmp_path / "report.html"
    assert '<p class="pages"></p>' in first.read_text(encoding="utf-8")
    pour(report({}), {}, tmp_path, "ladder", html=True, pdf=False)
    both = '<p class="pages"><b>Identification</b> <a href="ladder.html">Ladder of models</a></p>\n<header>'
    assert both in first.read_text(encoding="utf-8")
    second = (tmp_path / "ladder.html").read_text(encoding="utf-8")
    assert '<p class="pages"><a href="report.html">Identification</a> <b>Ladder of models</b></p>\n<header>' in second
    render(until("plan"), tmp_path, pdf=False)
    assert both in first.read_text(encoding="utf-8")


def test_an_output_below_its_own_numerical_error_is_named_and_not_drawn():
    results, bulge = complete(), "middle_point:uz_max@3.9"
    drawn = {name: draw(results, name) for name in ("surface", "sensitivity", "shapes", "morris")}
    for s in results["searches"]:
        for o in (o for c in s["candidates"] for o in c["outputs"] if o["output"] == bulge):
            o["numerical_error"] = o["recomputed"] and 2 * abs(o["recomputed"])
    said = "Not drawn, because smaller than its own numerical error: uz max at 3.9 mm (3.8"
    assert said in page(results) and said not in page(complete())
    assert all(draw(results, name) != figure for name, figure in drawn.items())
    assert not any("uz max" in cell for cell in table_of(results, "Local effects and Sobol indices")["Output"])


def test_why_a_surrogate_was_taken_is_a_folded_table():
    results = complete()
    results["surrogates"][0]["story"] = (
        "Kriging, Matérn 5/2, trend of degree 2: cross-validation error 0.2 mm^2 (1 %) over 8 runs; polynomial of "
        "degree 3 had 1.1 mm^2 (3 %); kriging had 0.3 mm^2 (2 %). Fitted again to 13 runs."
    )
    t = table_of(results, "Why these surrogates")
    assert t["taken"][0] == "Kriging, Matérn 5/2, trend of degree 2"
    assert t["others, cross-validated"][0].startswith("polynomial of degree 3 had 1.1 mm² (3\xa0%); kriging had 0.3")
    assert "Fitted again" not in t["others, cross-validated"][0] and "Fitted again" not in page(results)


def test_a_force_about_zero_is_said_in_newtons():
    """A share of nothing says nothing: neither of a mean about zero nor of a reading within its noise."""
    results = complete()
    name = next(iter(results["baseline"]))
    assert f"measured curve {name} with an NRMSE of" in page(results)
    results["baseline"][name]["nrmse"] = 11.0
    told = page(results)
    assert f"measured curve {name} with an RMSE of" in told and f"{name} with an NRMSE of" not in told
    row = {"channel": "Fy", "unit": "N", "depth": [4.0], "measured": [0.001], "predicted": [0.0], "sigma": [0.001]}
    assert "too low" not in predictive_check._off([row]) and "hardly more than noise" in predictive_check._off([row])
    assert "100" in predictive_check._off([{**row, "measured": [0.1]}])


@pytest.mark.parametrize("p", [1.0, 1.5, 3.0])
def test_a_curve_that_grows_as_a_power_is_not_about_zero(p):
    u = np.linspace(0, 1, 400)[1:]
    base = dataclasses.asdict(baseline(u**p))
    np.testing.assert_allclose(base["nrmse"], p / np.sqrt(2 * p + 1), rtol=0.02)  # 400 points for an integral
    assert not about_zero(base) and about_zero(dataclasses.asdict(baseline(np.sin(40 * u))))
