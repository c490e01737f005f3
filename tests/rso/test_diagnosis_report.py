import functools
import html
import re

import matplotlib
import pytest
from diagnosis_fixture import VERDICTS, read_back, story

from rso.report import render_diagnosis
from rso.report.discrepancy.figures import draw, power, probabilities
from rso.report.discrepancy.maps import MAX_MAP_PANELS, N_FIRST_PANELS, residual_map
from rso.report.discrepancy.reading import interval, panels, signatures, sized
from rso.report.discrepancy.report import report
from rso.report.discrepancy.signatures import N_SIGNATURE_ROWS, colours, signature_map
from rso.report.layout.document import Facts, Picture, Table, Text
from rso.report.layout.page import pictures

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
                found += [b.title, b.note, *(c.title for c in b.columns), *(cell.text for r in b.rows for cell in r)]
            elif isinstance(b, Facts):
                found += [t for f in b.facts for t in (f.label, f.value, f.note)]
            elif isinstance(b, Text | Picture):
                found.append(b.text if isinstance(b, Text) else b.caption)
    return found


def said(found):
    return " ".join(texts(report(found))).replace("\xa0", " ")


def section(found, name):
    return next(s for s in report(found).sections if s.id == name)


def drawn_texts(figure):
    return [t.get_text() for t in figure.axes[0].texts]


def axes_drawn(found, name):
    return len(set(re.findall(rf'id="{name}-(axes_\d+)"', draw(found, name))))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Of a verdict, its files: they are made once."""
    folder = tmp_path_factory.mktemp("written")
    return functools.cache(lambda verdict: render_diagnosis(story(verdict), folder / "new" / verdict))


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_gives_both_files(verdict, written):
    found, files = read_back(story(verdict)), written(verdict)
    assert [f.name for f in files] == ["diagnosis.html", "diagnosis.pdf"]
    source = files[0].read_text(encoding="utf-8")
    assert set(re.findall(r"""https?://[^"'\s>]+""", source)) <= {
        "http://www.w3.org/2000/svg",
        "http://www.w3.org/1999/xlink",
    }
    assert source.count("<script") == 1  # the page's own, written in
    assert not re.search(r"<script [^>]*src|<link|<img|@import|url\((?!#)", source)
    ids = re.findall(r'\bid="([^"]+)"', source)
    assert len(ids) == len(set(ids))
    assert files[1].read_bytes().startswith(b"%PDF-")
    text = said(found)
    assert [s.id for s in report(found).sections][:3] == ["verdict", "where", "which"]
    for sentence in found["words"]:
        assert sentence in text
    for bad in ("None", "nan", "e-0", "e+0"):
        assert bad not in text


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_german_page_has_a_template_for_every_sentence(verdict, tmp_path):
    missing = []
    (page,) = render_diagnosis(read_back(story(verdict)), tmp_path, pdf=False, language="de", untranslated=missing)
    assert page.name == "diagnosis.de.html"
    own = {"the same test with the surface wetted", "a ball of 6 mm radius"}  # of the fixture, no backend says them
    assert not set(missing) - own, "\n".join(missing)


def test_same_data_same_bytes_whatever_the_users_settings(tmp_path, written):
    first = written("explained")
    with matplotlib.rc_context({"font.size": 30, "axes.grid": True, "svg.fonttype": "none"}):
        again = render_diagnosis(read_back(story("explained")), tmp_path / "b")
    for a, b in zip(first, again, strict=True):
        assert a.read_bytes() == b.read_bytes(), a.name
    other = story("explained") | {"title": "another"}  # negative control
    assert report(other) != report(story("explained"))


def test_only_what_is_asked_for_is_written(tmp_path):
    assert [f.name for f in render_diagnosis(story("no_gap"), tmp_path, pdf=False)] == ["diagnosis.html"]


@pytest.mark.parametrize(
    ("verdict", "words"),
    [
        ("no_gap", ["reproduces these measurements within their noise", "no cause is named", "No share is printed"]),
        ("explained", ["this explains it: relaxing share of the shear modulus", "0.170 to 0.250", "0.24 % of Fz"]),
        ("ambiguous", ["separate the causes: Coulomb friction", "; or work of adhesion", "promises an answer"]),
        ("partly", ["is part of it, not all", "stiffness of the skin"]),
        ("unexplained", ["nothing in the catalogue explains it", "No cause of the catalogue is named"]),
        ("measurement", ["Not the model but the measurement is off: load-train compliance"]),
    ],
)
def test_the_verdict_is_said_in_words(verdict, words):
    text = said(story(verdict))
    for w in words:
        assert w in text, w


def test_one_odd_experiment_leads_the_page_and_has_no_say_in_the_regions():
    found = story("unexplained")
    assert "The model misses something" in said(found)
    found["diagnosis"]["odd"] = {"experiment": "deep {0}", "probability": 0.97}
    text = said(found)
    assert "deep {0} does not agree with the other experiments" in text and "The model misses something" not in text
    assert "fitted to all other data, those of deep {0} left out" in text


def test_what_is_fixed_stands_beside_the_intervals_of_what_is_not():
    found = read_back(story("explained"))
    assert "Fixed by the study" not in said(found)
    bands = found["diagnosis"]["parameters"]
    for when in ("before", "after"):
        bands[when].pop("D1")
    held = {**found, "fixed": {"D1": 4.25}, "units": {"mu": "MPa", "D1": "1/MPa"}}
    own = " ".join(b.text for b in section(held, "parameters").blocks if isinstance(b, Text)).replace("\xa0", " ")
    assert "Fixed by the study, not fitted: D₁ = 4.250 MPa⁻¹." in own
    (rows,) = (b for b in section(held, "parameters").blocks if isinstance(b, Table))
    assert [r[0].text for r in rows.rows] == ["μ"]
    for when in ("before", "after"):
        bands[when].clear()
    assert "There are no fitted parameters. Fixed by the study, not fitted: D₁" in said(held)


def test_one_panel_per_experiment_and_channel_the_strongest_first():
    found = story("explained")
    rows = panels(found)
    assert len(rows) == len({(r["experiment"], r["channel"]) for r in found["residuals"]})
    assert [(p.experiment, p.channel) for p in rows[:3]] == [("cycle_100", "Fz"), ("cycle_10", "Fz"), ("aside", "Fz")]
    assert rows[1].regions == ((1, 2.0, 4.0), (0, 1.3, 2.7)) and rows[2].regions == ()
    assert axes_drawn(found, "residuals") == N_FIRST_PANELS
    assert axes_drawn(found, "residuals-more") == min(len(rows), MAX_MAP_PANELS) - N_FIRST_PANELS
    many = story("explained")
    many["residuals"] += [r | {"experiment": f"more {k}"} for k, r in enumerate(many["residuals"][:4])]
    assert axes_drawn(many, "residuals-more") == MAX_MAP_PANELS - N_FIRST_PANELS
    assert "4 more panels, weaker than these, are not drawn" in said(many)
    few = story("explained")
    few["residuals"] = few["residuals"][:1]
    assert "residuals-more" not in pictures(report(few)) and axes_drawn(few, "residuals") == 1


@pytest.mark.parametrize("longest", [4.0, 20.0, 3000.0])
def test_times_of_a_hold_are_plain_numbers(longest):
    """Powers of ten are formulas, which no figure has: they stood there as their source, across the panel."""
    found = story("explained")
    for r in found["residuals"]:
        if r["experiment"] == "cycle_100":
            n = len(r["depth"])
            r |= {"since": [0.1 * (longest / 0.1) ** (k / (n - 1)) for k in range(n)], "branch": [2] * n}
    figures = [residual_map(found), residual_map(found, more=True)]
    for figure in figures:
        figure.draw_without_rendering()
    held = [a for figure in figures for a in figure.axes if a.get_xlabel() == "time at rest (s)"]
    assert held
    for axes in held:
        low, high = axes.get_xlim()
        shown = [t.get_text() for t in axes.get_xticklabels() if low <= t.get_position()[0] <= high]
        assert 2 <= len(shown) <= 7 and all(float(t) > 0 for t in shown)
        assert not any(t.get_text() for t in axes.get_xticklabels(minor=True))


def as_it_was(found):
    """A file of before signatures stood beside residuals: changes of Fz by place."""
    way = {"peak": None, "earlier": 0.0, "Fx": [0.0], "Fy": [0.0], "Fz": [0.1]}
    row = {"effect": "friction", "place": [0.0, 0.0], "travel": [1.0], "passes": [way]}
    return found | {"signatures": [row]}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_signatures_stand_beside_the_strongest_residuals(verdict, tmp_path):
    found = read_back(story(verdict))
    rows = signatures(found)
    if verdict in ("no_gap", "unexplained"):
        assert not rows and "signatures" not in pictures(report(found))
        return
    assert [(p.experiment, p.channel) for p, _ in rows] == [(p.experiment, p.channel) for p in panels(found)]
    figure = signature_map(found)
    assert len(figure.axes) == 2 * N_SIGNATURE_ROWS == axes_drawn(found, "signatures")
    for k, (p, _) in enumerate(rows[:N_SIGNATURE_ROWS]):
        left, right = figure.axes[2 * k : 2 * k + 2]
        assert left.get_title().startswith(p.experiment) and left.get_ylim() == right.get_ylim()
        assert p.unit.label in left.get_ylabel() and p.unit.label in right.get_ylabel()
    assert "heights compare" in said(found)
    for old in (as_it_was(found), {k: v for k, v in found.items() if k != "signatures"}):
        assert "signatures" not in pictures(report(old))
        if verdict == "ambiguous":
            assert len(render_diagnosis(old, tmp_path)) == 2


def test_the_line_through_a_residual_is_what_the_cause_takes_up_of_it():
    found = story("ambiguous")
    names = colours(found)
    assert list(names) == ["friction", "adhesion"] and len(set(names.values())) == 2
    _, right = signature_map(found).axes[:2]
    (p, own), *_ = signatures(found)
    f = p.unit.factor
    for record, s in zip(p.records, own, strict=True):
        for branch in (0, 1):
            k = s.branch == branch
            want = f * (record.base - record.cause)[k]
            assert any(
                len(line.get_ydata()) == k.sum() and abs(line.get_ydata() - want).max() < 1e-9 * f
                for line in right.lines
                if line.get_color() == names["friction"]
            )


@pytest.mark.parametrize("kind", ["profile", "hold"])
def test_a_signature_of_marks_and_of_a_hold_is_drawn_over_what_its_residual_is(kind):
    found = story("ambiguous")
    name = "profile" if kind == "profile" else "cycle_100"
    found["diagnosis"]["where"] = [
        {
            "experiment": name,
            "channel": "uz" if kind == "profile" else "Fz",
            "region": "profile at 4 mm" if kind == "profile" else "held 1–4 s",
        }
    ]
    for r in (*found["residuals"], *found["signatures"]):
        if kind == "hold" and (r["experiment"], r["channel"]) == (name, "Fz"):
            n = len(r["depth"])
            r |= {"since": [0.1 * 1.1**k for k in range(n)], "branch": [2] * n}
    (p, own), *_ = signatures(found)
    assert p.profile == (kind == "profile") and p.held == (kind == "hold") and len(own) == 1
    left, right = signature_map(found).axes[:2]
    for axes, color in ((left, colours(found)["adhesion"]), (right, colours(found)["friction"])):
        assert sum(len(line.get_xdata()) for line in axes.lines if line.get_color() == color) == len(own[0].depth)
    assert (right.get_xlabel() == "time at rest (s)") == (kind == "hold")
    assert left.get_xlim() == pytest.approx(right.get_xlim(), rel=0.2)


def test_repeats_that_differ_are_lines_of_their_own():
    """A change from test to test would else be drawn as its mean, which no test has."""
    found = story("explained")
    aside = [r for r in found["signatures"] if (r["experiment"], r["channel"]) == ("aside", "Fz")]
    row = [(p.experiment, p.channel) for p, _ in signatures(found)].index(("aside", "Fz"))
    drawn = []
    for share in (1.0, 1.01, 2.0):
        for k, r in enumerate(aside):
            r["added"] = {"prony_g": [0.01 * u * share**k for u in r["depth"]]}
        left = signature_map(found).axes[2 * row]
        drawn.append(sum(line.get_color() == colours(found)["prony_g"] for line in left.lines))
    assert drawn == [1, 1, 2]


def test_what_scatters_has_no_line_and_what_did_not_hold_is_said_not_to():
    found = story("ambiguous")
    assert "None of these" not in said(found) and "no line" not in said(found)
    for r in found["residuals"]:
        r["residual"]["offset_each"] = r["residual"].pop("friction")
    for r in found["signatures"]:
        del r["added"]["friction"]
    kept = colours(story("ambiguous"))["friction"]
    assert "What offset_each does to each curve for itself has no mean, and so no line" in said(found)
    assert list(colours(found)) == ["adhesion"] and kept not in colours(found).values()
    for r in found["residuals"]:
        del r["residual"]["offset_each"]
    assert "None of these hypotheses held" in said(found)


def test_keys_of_many_hypotheses_with_long_names_stay_on_the_page():
    found = story("ambiguous")
    names = [
        "offset_y at (2.5, 2.5) + bowl_clearance",
        "offset_y at (2.5, 2.5)",
        "bowl_clearance",
        "compliance at (20, 0)",
        "inclusion_ratio",
    ]
    for r in found["residuals"]:
        r["residual"][names[0]] = r["residual"].pop("friction")
    for r in found["signatures"]:
        r["added"] = {n: [(k + 1) * v for v in r["added"]["friction"]] for k, n in enumerate(names)}
    figure = signature_map(found)
    assert len(set(colours(found).values())) == len(names)
    figure.draw_without_rendering()
    (keys,) = figure.legends
    assert keys.get_window_extent().x1 <= figure.bbox.x1


def test_readings_that_are_not_known_leave_no_trace():
    found = story("explained")
    before = [len(p.records[0].base) for p in panels(found)]
    for r in found["residuals"]:
        r["depth"][3] = r["residual"]["none"][5] = None
    assert [len(p.records[0].base) for p in panels(found)] == [n - 2 for n in before]
    draw(found, "residuals")


def test_foreign_text_is_never_markup(tmp_path):
    found = story("ambiguous")
    found["title"] = NASTY
    found["words"] = [NASTY]
    found["notes"] = found["failed_runs"] = [NASTY, "\x00\x1b"]
    found["command"] = NASTY
    found["effects"][6]["description"] = found["diagnosis"]["causes"][0]["description"] = NASTY
    for rows in (found["experiments"], found["residuals"], found["diagnosis"]["where"], found["held_out"]):
        rows[0] |= {"name" if rows is found["experiments"] else "experiment": NASTY}
    found["diagnosis"]["next_test"][0]["test"] = NASTY
    source, pdf = (f.read_bytes() for f in render_diagnosis(found, tmp_path))
    page = source.decode("utf-8")
    assert (
        page.count("<script") == 1 and "<script>alert" not in page and "\x00" not in page and pdf.startswith(b"%PDF-")
    )
    visible = html.unescape(re.sub(r"<[^>]*>", " ", re.sub(r"(?s)<svg.*?</svg>", "", page)))
    assert visible.count(NASTY) >= 8


def test_what_is_missing_is_said_to_be_missing(tmp_path):
    assert "There is no verdict" in said({})
    assert len(render_diagnosis({}, tmp_path)) == 2
    whole = read_back(story("ambiguous"))
    for key in whole:
        found = {k: v for k, v in whole.items() if k != key}
        for name in pictures(report(found)) if key != "words" else []:
            if key in ("diagnosis", "residuals", "effects", "experiments"):
                draw(found, name)
    for key in whole["diagnosis"]:
        for value in ({}, None):
            report(whole | {"diagnosis": {k: v for k, v in whole["diagnosis"].items() if k != key} | (value or {})})
            report(whole | {"diagnosis": whole["diagnosis"] | {key: None}})


def test_one_curve_leaves_nothing_to_test_a_cause_on():
    found = story("explained")
    found["diagnosis"]["shrinkage"] |= {"before": None, "refit_only": None, "with_cause": None, "curves": []}
    assert "nothing is left to test a cause on" in said(found) and "shrinkage" not in pictures(report(found))
    found["held_out"] = []
    assert "Does it predict" not in said(found)


def test_held_out_gains_add_up():
    rows = next(
        b.rows
        for b in section(story("explained"), "which").blocks
        if isinstance(b, Table) and b.title.startswith("Does it predict")
    )
    assert [c.text for c in rows[-1]][:2] == ["all together", "+36.7"]


def test_numbers_are_shown_to_the_digits_of_their_interval():
    assert interval((0.00990, 0.0103, 0.01070), "MPa") == ("10.30\xa0kPa", "9.90 to 10.70\xa0kPa")
    assert interval((1.67, 11.66, 30.5), "1/MPa") == ("12\xa0MPa⁻¹", "1.7 to 30\xa0MPa⁻¹")
    assert interval((1.029, 1.031, 1.033), "1") == ("1.0310", "1.0290 to 1.0330")
    cause = {"size": 0.67e-3, "interval": [0.45e-3, 0.90e-3], "unit": "MPa", "neutral": 0.0}
    assert sized(cause) == ("0.67\xa0kPa", "0.45 to 0.90\xa0kPa", "0\xa0kPa")
    assert sized({"size": 0.011, "interval": [0.007, 0.016], "unit": "N/mm^3", "neutral": None})[2] == "–"


def test_a_cause_whose_interval_holds_its_absence_is_said_to_be_perhaps_absent():
    found = story("explained")
    cause = found["diagnosis"]["causes"][0]
    assert "may be absent" not in said(found)
    cause |= {"neutral": cause["size"]}
    assert "may be absent" in said(found)


def test_a_cause_of_the_other_sign_whose_ends_are_not_known_is_still_told():
    found = story("explained")
    cause = found["diagnosis"]["causes"][0]
    cause["otherwise"] = {"probability": 0.2, "low": cause["size"], "high": 2 * cause["size"]}
    assert "with the other sign, " in said(found) and ": 20 %." in said(found)
    cause["otherwise"]["high"] = None
    assert "with the other sign: 20 %." in said(found)


def test_tests_that_settle_nothing_have_no_row():
    found = story("ambiguous")
    one = found["diagnosis"]["next_test"][0]
    found["diagnosis"]["next_test"] = [one | {"chance": 0.4}, one | {"test": "idle", "chance": 0.004}]
    assert "idle" not in said(found) and "Left out because they decide nothing (chance below 1 %): 1." in said(found)
    found["diagnosis"]["next_test"] = [one | {"chance": 0.0}]
    assert "None of 1 proposed tests would separate the causes" in said(found)


@pytest.mark.parametrize(
    ("verdict", "words"),
    [
        ("no_gap", "No gap was found, so there are no rival causes that a test could separate. Effects may be there"),
        ("explained", "One explanation is left, so no test is needed"),
        ("ambiguous", "No test was found that separates these causes: repeats"),
        ("unexplained", "looks like nothing in the catalogue, so no further test is proposed"),
    ],
)
def test_why_no_test_is_proposed_goes_with_the_verdict(verdict, words):
    """Without a gap a further test may still show what this plan does not see, and narrow the parameters."""
    found = story(verdict)
    found["diagnosis"]["next_test"] = []
    assert words in said(found)
    blind = [v for v in found["diagnosis"]["detectable"] if not v["visible"]]
    assert (f"{len(blind)} of {len(found['diagnosis']['detectable'])} at no plausible size" in said(found)) == (
        verdict == "no_gap" and bool(blind)
    )
    assert ("which rso next answers" in said(found)) == (verdict == "no_gap")


def test_on_the_border_repeats_come_first():
    found = story("no_gap")
    found["diagnosis"]["next_test"] = []
    found["diagnosis"]["gap"]["p_value"] = 0.06
    assert "more repeats of these tests, or less noise, decide it" in said(found)


def test_a_share_that_is_not_known_is_not_printed():
    found = story("explained")
    assert "95 % of what exceeds the noise floor is closed (90 %: 81 to 99 %)" in said(found)
    found["diagnosis"]["shrinkage"] |= {"closed": None, "interval": None}
    assert "No share is printed" in said(found) and "is closed" not in said(found)


def test_a_share_says_nothing_of_what_every_curve_has_for_itself():
    found = story("explained")
    assert "Gap closed" in said(found) and "for itself" not in said(found)
    found["diagnosis"]["shrinkage"]["interval"] = [-0.6, 0.1]
    assert "−60 to 10 %" in said(found)
    found["diagnosis"]["causes"][0]["family"] = "scatter"
    for row in found["diagnosis"]["where"]:
        row["beyond_noise"] = False
    assert "Gap closed" not in said(found) and "this share says nothing of it" in said(found)
    assert "one of single curves" in said(found) and "one of shape" not in said(found)


def test_an_unknown_figure_is_refused():
    with pytest.raises(ValueError, match="no figure"):
        draw(story(), "nothing")


def test_an_ambiguous_verdict_says_what_it_leaves_open():
    found = story("ambiguous")
    assert "spread over" not in said(found) and "no gap at all" not in said(found)
    assert "misses something" in said(found)
    for c, q in zip(found["diagnosis"]["causes"], (0.20, 0.08), strict=True):
        c["probability"] = q
    found["probabilities"]["none"] = 0.41
    text = said(found)
    assert "these hold 28 % of the probability; the rest is spread over what is less likely" in text
    assert "That there is no gap at all has 41 %" in text
    assert "may miss something" in text and "misses something" not in text


def test_a_factor_of_every_test_is_of_cell_or_specimen_only_where_it_stands_alone():
    found = story("ambiguous")
    causes = found["diagnosis"]["causes"]
    causes[0]["like_a_modulus"] = True
    assert len(causes) > 1 and "no cause reaches 95 %" in said(found)
    del causes[1:]
    assert "load cell or specimen" in said(found)


def test_a_share_of_one_curve_is_said_to_be_one():
    found = story("explained")
    curves = found["diagnosis"]["shrinkage"]["curves"]
    assert "is in deep alone: this is a share of one curve" in said(found)  # 10.2 of 10.6
    curves[1]["before"] = 5.0
    assert "share of one curve" not in said(found)
    curves[:] = curves[:1]
    assert "share of one curve" not in said(found)


def test_curves_left_out_in_turn_took_part_in_finding_the_cause():
    found = story("explained")
    assert "on curves that took no part in finding the cause" in said(found)
    for e in found["experiments"]:
        e["role"] = "fit"
    assert "took no part in the fit, though in finding the cause" in said(found)
    for c in found["diagnosis"]["shrinkage"]["curves"]:
        c["cause"] = ["prony_g"]
    assert "on curves that took no part in finding the cause" in said(found)
    found["diagnosis"]["shrinkage"]["curves"][0]["cause"] = []
    assert "cause without it" in said(found)


def test_a_limit_below_the_smallest_size_that_was_simulated_is_no_limit():
    """The ladder of sizes begins at some size: one that is seen there already is visible from less."""
    found = story("explained")
    assert "≤" not in said(found)
    powers = {p["effect"]: p for p in found["power"]}
    powers["prony_g"]["power"] = [(s, max(q, 0.9)) for s, q in powers["prony_g"]["power"]]
    assert "≤ 0.031" in said(found) and said(found).count("≤ 0.") == 1
    assert "≤: nothing smaller was simulated" in said(found)
    assert "≤ 0.031" in drawn_texts(power(found))


def test_hypotheses_are_called_by_what_people_call_them():
    """In bars and tables; the knob to switch on stands beside.  What has no label goes by the name of its knob."""
    found = story("measurement")
    for e in found["effects"]:
        e["label"] = {"offset": "contact point", "prony_g": "relaxation"}.get(e["name"], "")
    found["probabilities"] = {"offset": 0.5, "offset + prony_g": 0.3, "gain": 0.2}
    labels = [t.get_text() for t in probabilities(found).axes[0].get_yticklabels()]
    assert labels == ["contact point", "contact point and relaxation", "gain"]
    tables = {b.title: b for s in report(found).sections for b in s.blocks if isinstance(b, Table)}
    rows = [[c.text for c in row[:2]] for row in tables["Limits of this plan"].rows]
    assert ["relaxation", "prony_g"] in rows and ["bias", "bias"] in rows


def test_one_run_is_one():
    found = story("explained")
    found["rerun"] = [{"effects": ["prony_g"], "runs": 1, "failed": 0, "rms": 0.01, "largest": 0.02}]
    assert "prony_g (1 run, 0 failed)" in said(found)
