"""The pages in a real Chromium: silent, self-contained, fitting, readable."""

import re
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.files.readings import GaugeIdentity
from orthoglide_cal.model.machine import Details
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.html import html
from tests.report.cases import DOCUMENTS, changed, report_of
from tests.report.chromium import Browser, find_chromium
from tests.results import cases

PROGRAM = find_chromium()
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="there is no Chromium on this machine")

WIDTHS = (390, 500, 1280)
# Content of an A4 page with the margins of the style sheet, at 96 dots per inch.
A4_CONTENT = round((210 - 30) / 25.4 * 96)
# Documents that a command writes as a page.
KINDS = (*cases.CASES, "as_left", "verified", "planned", "remembered")


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with closing(Browser(PROGRAM, tmp_path_factory.mktemp("browser"))) as running:
        yield running


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    files = {name: folder / f"{name}.html" for name in KINDS}
    for name, path in files.items():
        path.write_text(html(DOCUMENTS[name]().page()), encoding="utf-8")
    return files


@pytest.mark.parametrize("kind", KINDS)
def test_page_is_silent_alone_fits_and_is_printed(
    chromium: Browser, pages: dict[str, Path], kind: str
):
    """On every width, and on numbered A4 pages."""
    apart = [] if kind == "hostile" else ["covered"]
    chromium.open(pages[kind])
    assert chromium.complaints() == []
    asked = [event["request"]["url"] for event in chromium.of("Network.requestWillBeSent")]
    outside = [url for url in asked if not url.startswith("data:")]
    assert outside == [pages[kind].as_uri()]
    for width in WIDTHS:
        chromium.view(width)
        for faults in ("overflow", "cut", "overprinted", "small", *apart):
            assert chromium.evaluate(f"{faults}()") == [], (faults, width)
    pdf = chromium.pdf()
    sizes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf)
    count = len(re.findall(rb"/Type /Page\b", pdf))
    assert 1 <= count <= {"hostile": 14, "as_left": 7}.get(kind, 5)
    for width, height in sizes:
        assert float(width) == pytest.approx(595.0, abs=1.0)
        assert float(height) == pytest.approx(842.0, abs=1.0)
    chromium.view(A4_CONTENT, media="print")
    for faults in ("overflow", "small", *apart):
        assert chromium.evaluate(f"{faults}()") == [], faults
    # Decision, offsets, what to do and the lines to sign on: above the first break.
    if kind not in ("hostile", "failed", "verified", "planned", "remembered"):
        ((*_, end),) = chromium.evaluate("boxes('.sign')")
        assert end < (297 - 31) / 25.4 * 96


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_what_to_enter_stands_on_the_first_screen(
    chromium: Browser, pages: dict[str, Path], width: int, height: int
):
    chromium.open(pages["healthy"], width=width)
    below = [bottom for *_, bottom in chromium.evaluate("boxes('.tiles tbody tr')")]
    assert len(below) == 3
    assert max(below) < height


def written(path: Path, case: Case, name: str) -> Path:
    """The page of a case, of a machine with such a name and details of the laboratory."""
    report = Details(
        organisation="Calibration Ltd", place="hall 3", customer="Milling Ltd",
        serial_number="OG-17", method="double posture, work instruction 12",
        gauge_due="2027-01-31",
    )  # fmt: skip
    model = changed(case.given.model, name=name, report=report)
    whole = html(report_of(replace(case, given=replace(case.given, model=model))).page())
    path.write_text(whole, encoding="utf-8")
    return path


def test_a_report_without_a_result_takes_one_sheet_of_paper(chromium: Browser, tmp_path: Path):
    """Two pages, with all that a session can hold."""
    full = cases.COMPLETE.changed(
        environment={f"remark {k}": "draught from the door " * 3 for k in range(6)},
        gauges=tuple(GaugeIdentity(id=f"no. {k}", certificate=f"2026-{k:04d}", resolution_mm=0.01)
                     for k in range(6)),
        notes=tuple((k, "touched the stand") for k in range(60)),
    )  # fmt: skip
    failed = cases.failed()
    failed = replace(failed, given=replace(failed.given, conditions=full))
    chromium.open(written(tmp_path / "failed.html", failed, "Machine"))
    assert len(re.findall(rb"/Type /Page\b", chromium.pdf())) <= 2


@pytest.mark.parametrize(("width", "media"), [(360, ""), (800, ""), (A4_CONTENT, "print")])
def test_a_long_name_leaves_the_decision_in_sight(
    chromium: Browser, tmp_path: Path, width: int, media: str
):
    page = written(tmp_path / "long.html", cases.healthy(), "A very long name of a machine " * 17)
    chromium.open(page, width=width, media=media)
    (*_, end), *_ = chromium.evaluate("boxes('.notice')")
    assert end < 740  # of a telephone's screen of 360 × 740, in the first view
    # The name is cut where it heads the page, and whole where the machine is described.
    whole = chromium.evaluate(
        "[...document.querySelectorAll('dd bdi')].filter(e => e.textContent.length > 490"
        " && e.parentElement.scrollHeight <= e.parentElement.clientHeight + 1).length"
    )
    assert whole == 1


def test_one_click_selects_a_command(chromium: Browser, pages: dict[str, Path]):
    chromium.open(pages["healthy"])
    (left, right, top, bottom), *_ = chromium.evaluate("boxes('.command')")
    place = {"x": 0.75 * left + 0.25 * right, "y": 0.5 * (top + bottom)}
    for kind in ("mousePressed", "mouseReleased"):
        chromium.call("Input.dispatchMouseEvent", type=kind, button="left", clickCount=1, **place)
    selected = chromium.evaluate("getSelection().toString()")
    assert selected.strip() == "orthocal export made.csv --format linuxcnc"


def test_a_wide_screen_is_used(chromium: Browser, pages: dict[str, Path]):
    for width, columns in ((800, 1), (1200, 1), (1600, 2)):
        chromium.open(pages["named_in_machine"], width=width)
        found = chromium.evaluate("boxes('section')")
        assert len({round(left) for left, *_ in found}) == columns
        covered = max(right for _, right, *_ in found) - min(left for left, *_ in found)
        assert covered > min(0.9 * width, 1050 * columns)
        for a, b in combinations(found, 2):
            apart = a[0] >= b[1] - 1 or b[0] >= a[1] - 1
            assert apart or a[2] >= b[3] - 1 or b[2] >= a[3] - 1, (a, b)


def test_pictures_do_not_glare_in_the_dark(chromium: Browser, pages: dict[str, Path]):
    for dark in (False, True):
        chromium.open(pages["named_in_machine"], dark=dark)
        light = [_luminance(fill) for fill in chromium.evaluate("fills('.heat')")]
        assert (max(light) < 0.4) is dark
        # Each step of a scale differs from its neighbours, and from the first to the last goes on.
        steps = chromium.evaluate("""fills('svg[viewBox="0 0 276 30"] .heat')""")
        levels = [_luminance(fill) for fill in steps]
        assert levels == sorted(levels, reverse=not dark)
        assert len(set(levels)) == 7


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("kind", ["healthy", "as_left"])
def test_text_contrast_in_both_schemes(
    chromium: Browser, pages: dict[str, Path], kind: str, dark: bool
):
    """At least 4.5 : 1, as WCAG 2 asks of text."""
    chromium.open(pages[kind], dark=dark)
    found = chromium.evaluate("colours()")
    assert len(found) > 50
    paper = {back for _, _, back in found}
    assert any(_luminance(back) < 0.1 for back in paper) is dark
    # Lines of pictures: at least 3 : 1, as it asks of graphics.
    back = min(paper, key=_luminance) if dark else "rgb(255, 255, 255)"
    for name, stroke, opacity in chromium.evaluate("strokes()"):
        assert _contrast(stroke, back) >= 3.0, name
        assert opacity == "1", name
    for tag, front, back in found:
        assert _contrast(front, back) >= 4.5, (tag, front, back)


def _contrast(one: str, other: str) -> float:
    low, light = sorted(map(_luminance, (one, other)))
    return (light + 0.05) / (low + 0.05)


def _luminance(colour: str) -> float:
    values = np.array([float(v) for v in re.findall(r"[\d.]+", colour)[:3]]) / 255.0
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))
