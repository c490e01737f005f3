"""The page of a report in headless Chromium: console, network, controls, names, contrast, widths."""

import html
import itertools
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from report_fixture import complete, deformed, draws

from rso.report import render

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
SCREEN = 900  # px

pytestmark = [
    pytest.mark.verification,
    pytest.mark.skipif(BROWSER is None, reason="Chromium is not installed"),
]

WATCH = """<script>
window.wrong = [];
addEventListener("error", e => wrong.push(String(e.message)));
for (const k of ["error", "warn"]) console[k] = (...a) => wrong.push(a.join(" "));
</script>"""

LOOK = f"<script>{(Path(__file__).parent / 'look_at_page.js').read_text('utf-8')}</script>"


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    (page,) = render({**complete(), "deformed": deformed(), "draws": draws()}, folder, pdf=False)
    return page.read_text(encoding="utf-8")


def looked(source, folder, width):
    """What look_at_page.js finds in a window so wide; Chromium has no narrow ones, which are frames."""
    page = source.replace("<head>", f"<head>{WATCH}", 1).replace("</body>", f"{LOOK}</body>", 1)
    if width < 600:
        frame = f'<iframe style="border:0;width:{width}px;height:{SCREEN}px" srcdoc="{html.escape(page)}"></iframe>'
        page = f'<!DOCTYPE html><body style="margin:0">{frame}</body>'
    file = folder / "page.html"
    file.write_text(page, encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync"]
    options += [
        "--disable-component-update",
        f"--user-data-dir={folder / 'profile'}",
        f"--window-size={width},{SCREEN}",
    ]
    command = [BROWSER, *options, "--virtual-time-budget=20000", "--dump-dom", file.as_uri()]
    dom = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True).stdout
    found = json.loads(html.unescape(re.search(r'<pre id="found">(.*?)</pre>', dom, re.DOTALL)[1]))
    assert "broken" not in found, found
    return found


@pytest.fixture(scope="module", params=[1440, 768, 360])
def found(request, source, tmp_path_factory):
    return {"width": request.param, **looked(source, tmp_path_factory.mktemp(f"w{request.param}"), request.param)}


def test_nothing_is_wrong_and_nothing_is_asked_of_a_network(found):
    assert found["wrong"] == [] and found["asked"] == []


def test_nothing_is_wider_than_the_window(found):
    for wide, window in (found["wide"], found["open"]):
        assert wide <= window, found["over"]


def test_the_main_page_is_five_screens(found):
    if found["width"] == 1440:
        assert found["above"] <= 5 * SCREEN


def test_the_slider_moves_body_number_ring_and_bands(found):
    assert found["moved"] == [True] * 4 and found["said"].startswith("4 mm")
    first, second = found["field"]
    assert "stress" in first and "pressure" in second


def test_tables_sort_and_filter(found):
    assert found["sorted"] == [True, True, "descending"]
    assert found["filtered"] and all(found["filtered"])


def test_legends_hide_lines_and_the_pointer_shows_values(found):
    before, hidden, after = found["toggled"]
    assert hidden > before == after
    text, x, y = found["tip"]
    assert all(f"{v:.4g}" in text for v in (x, y))


def test_downloads_hold_the_figure_and_its_numbers(found):
    files = dict(found["saved"])
    assert files["curve-0.svg"].startswith("<svg") and "var(" not in files["curve-0.svg"]
    rows = [line.split(",") for line in files["curve-0.csv"].splitlines()]
    assert rows[0] == ["series", "x", "y"] and len(rows) > 40 and all(len(r) == 3 for r in rows)


def test_a_part_of_a_figure_is_enlarged_and_the_page_stays(found):
    zoom = found["zoom"]
    x, y, wide, tall = zoom["part"]
    assert wide < 0.5 * zoom["whole"][2] and tall / wide == pytest.approx(zoom["whole"][3] / zoom["whole"][2], rel=1e-2)
    assert x <= 100 and x + wide >= 150 and y <= 50 and y + tall >= 70
    assert zoom["kept"]
    assert zoom["closer"][2] < wide and zoom["beside"][0] > zoom["closer"][0]
    assert zoom["back"] == pytest.approx(zoom["whole"], abs=1e-2)


def test_everything_has_a_name_a_place_and_contrast(found):
    assert found["nameless"] == [] and found["pictures"] == 0 and found["flat"] == [] and found["twice"] == []
    levels = found["levels"]
    assert levels.count(1) == 1 and all(b <= a + 1 for a, b in itertools.pairwise(levels))
    assert found["unreachable"] == []
    assert found["pale"] == {"light": [], "dark": []}


def test_a_page_with_a_fault_is_noticed(source, tmp_path):
    """Negative control: an error, a request, a text too pale and a picture too wide are all found."""
    faults = '<script>undefinedThing()</script><p style="color:#ddd;background:#fff">pale</p>'
    faults += '<div style="width:9999px">-</div>'
    bad = source.replace("</main>", f"{faults}<button></button></main>", 1)
    found = looked(bad, tmp_path, 1440)
    assert found["wrong"] and found["pale"]["light"] and found["nameless"] and found["wide"][0] > found["wide"][1]
