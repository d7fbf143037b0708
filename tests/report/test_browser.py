"""The pages in a real Chromium: silent, self-contained, fitting, readable."""

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.files.readings import Conditions, GaugeIdentity
from orthoglide_cal.model.machine import Details
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.html import html
from tests.report.cases import changed, documents, report_of
from tests.report.chromium import Browser, browser, find_chromium
from tests.results import cases

PROGRAM = find_chromium()
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="there is no Chromium on this machine")

WIDTHS = (390, 500, 1280)
# Content of an A4 page with the margins of the style sheet, at 96 dots per inch.
A4_CONTENT = round((210 - 30) / 25.4 * 96)
# Documents that a command writes as a page.
KINDS = (*cases.CASES, "as_left", "verified", "planned", "remembered")

# Elements that reach beyond the page, unless a box of their own scrolls them.
OVERFLOW = """(() => {
  const edge = document.documentElement.clientWidth + 0.5, found = [];
  for (const e of document.querySelectorAll('body *')) {
    const box = e.getBoundingClientRect();
    if (box.width === 0 || e.closest('svg') !== null && e.tagName !== 'svg') continue;
    const scrolled = e.parentElement.closest('.scroll');
    if (scrolled === null && (box.right > edge || box.left < -0.5))
      found.push(e.tagName + ' ' + e.className + ' ' + Math.round(box.right));
  }
  if (document.documentElement.scrollWidth > edge) found.push('page scrolls sideways');
  return found;
})()"""

# Blocks that lie over each other, and tables that have to be scrolled.
COVERED = """(() => {
  const found = [...document.querySelectorAll('div.scroll')].filter(
    e => e.scrollWidth > e.clientWidth + 1).map(e => 'scrolled: ' + e.textContent.slice(0, 60));
  const blocks = [...document.querySelectorAll(
    'header > *, h2, .steps li, .scroll, .tiles, figure, section > p, section > dl, .sign, footer')
    ].map(e => [e, e.getBoundingClientRect()]).filter(([e, box]) => box.height > 0);
  blocks.forEach(([one, a], k) => blocks.slice(0, k).forEach(([other, b]) => {
    if (!one.contains(other) && !other.contains(one) && a.left < b.right - 1
        && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1)
      found.push(one.textContent.slice(0, 40) + ' / ' + other.textContent.slice(0, 40));
  }));
  return found;
})()"""

# Texts of a picture that are cut off at its edge by more than a letter.
CUT = """(() => {
  const found = [];
  for (const svg of document.querySelectorAll('svg')) {
    const frame = svg.getBoundingClientRect();
    for (const e of svg.querySelectorAll('text')) {
      const box = e.getBoundingClientRect();
      if (box.right > frame.right + 8 || box.left < frame.left - 8
          || box.bottom > frame.bottom + 8 || box.top < frame.top - 8)
        found.push(svg.querySelector('title').textContent + ': ' + e.textContent);
    }
  }
  return found;
})()"""

# Texts of pictures that are smaller than 10 px, and such as overprint each other.
SMALL = """(() => [...document.querySelectorAll('svg text')].filter(e => {
  const svg = e.ownerSVGElement, scale = svg.getBoundingClientRect().width
    / svg.viewBox.baseVal.width;
  return parseFloat(getComputedStyle(e).fontSize) * scale < 9.99;
}).map(e => e.textContent))()"""
OVERPRINTED = """(() => {
  const found = [];
  for (const svg of document.querySelectorAll('svg')) {
    const texts = [...svg.querySelectorAll('text')].map(
      e => [e.getBoundingClientRect(), e.textContent]);
    texts.forEach(([a, one], k) => texts.slice(0, k).forEach(([b, other]) => {
      if (a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 6
          && b.top < a.bottom - 6) found.push(one + ' / ' + other);
    }));
  }
  return found;
})()"""

# Colour of every text and of what lies behind it, as the browser computed them.
COLOURS = """(() => {
  const behind = e => {
    for (; e; e = e.parentElement) {
      const c = getComputedStyle(e).backgroundColor;
      if (c !== 'rgba(0, 0, 0, 0)') return c;
    }
    return 'rgb(255, 255, 255)';
  };
  return [...document.querySelectorAll('h1, h2, p, td, th, dt, dd, li, code, footer')]
    .filter(e => e.textContent.trim() && !e.closest('svg'))
    .map(e => [e.tagName, getComputedStyle(e).color, behind(e)]);
})()"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser(PROGRAM) as running:
        yield running


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    files = {name: folder / f"{name}.html" for name in KINDS}
    for name, path in files.items():
        path.write_text(html(documents()[name]().page()), encoding="utf-8")
    return files


@pytest.mark.parametrize("kind", KINDS)
def test_page_is_silent_alone_and_fits(chromium: Browser, pages: dict[str, Path], kind: str):
    for width in WIDTHS:
        chromium.open(pages[kind], width=width)
        assert chromium.complaints() == []
        outside = [url for url in chromium.requests() if not url.startswith("data:")]
        assert outside == [pages[kind].as_uri()]
        assert chromium.evaluate(OVERFLOW) == [], width
        assert kind == "hostile" or chromium.evaluate(COVERED) == [], width
        assert chromium.evaluate(CUT) == [], width
        assert chromium.evaluate(OVERPRINTED) == [], width
        assert chromium.evaluate(SMALL) == [], width


@pytest.mark.parametrize("kind", KINDS)
def test_print_is_a4_with_numbered_pages(chromium: Browser, pages: dict[str, Path], kind: str):
    chromium.open(pages[kind])
    pdf = chromium.pdf()
    boxes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf)
    count = len(re.findall(rb"/Type /Page\b", pdf))
    assert 1 <= count <= {"hostile": 14, "as_left": 7}.get(kind, 5)
    for width, height in boxes:
        assert float(width) == pytest.approx(595.0, abs=1.0)
        assert float(height) == pytest.approx(842.0, abs=1.0)
    chromium.open(pages[kind], width=A4_CONTENT, media="print")
    assert chromium.evaluate(OVERFLOW) == []
    assert chromium.evaluate(SMALL) == []
    assert kind == "hostile" or chromium.evaluate(COVERED) == []
    # Decision, offsets, what to do and the lines to sign on: above the first break.
    if kind not in ("hostile", "failed", "planned", "remembered"):
        end = chromium.evaluate("document.querySelector('.sign').getBoundingClientRect().bottom")
        assert end < (297 - 31) / 25.4 * 96


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_what_to_enter_stands_on_the_first_screen(
    chromium: Browser, pages: dict[str, Path], width: int, height: int
):
    chromium.open(pages["healthy"], width=width)
    ends = "[...document.querySelectorAll('.tile')].map(e => e.getBoundingClientRect().bottom)"
    assert len(below := chromium.evaluate(ends)) == 3
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
    full = Conditions(
        protocol="double-posture", operator="A. Martin", started="2026-03-03T09:00:00+01:00",
        finished="2026-03-03T09:31:00+01:00", temperature_c=(20.9, 21.6),
        environment=tuple((f"remark {k}", "draught from the door " * 3) for k in range(6)),
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
    end = chromium.evaluate("document.querySelector('.notice').getBoundingClientRect().bottom")
    assert end < 740  # of a telephone's screen of 360 × 740, in the first view
    # The name is cut where it heads the page, and whole where the machine is described.
    whole = chromium.evaluate(
        "[...document.querySelectorAll('dd bdi')].filter(e => e.textContent.length > 490"
        " && e.parentElement.scrollHeight <= e.parentElement.clientHeight + 1).length"
    )
    assert whole == 1


def test_one_click_selects_a_command(chromium: Browser, pages: dict[str, Path]):
    chromium.open(pages["healthy"])
    box = chromium.evaluate(
        "(() => { const b = document.querySelector('.command').getBoundingClientRect();"
        " return [b.left + b.width / 4, b.top + b.height / 2]; })()"
    )
    for kind in ("mousePressed", "mouseReleased"):
        chromium.call("Input.dispatchMouseEvent", type=kind, x=box[0], y=box[1], button="left",
                      clickCount=1)  # fmt: skip
    selected = chromium.evaluate("getSelection().toString()")
    assert selected.strip() == "orthocal export made.csv --format linuxcnc"


def test_a_wide_screen_is_used(chromium: Browser, pages: dict[str, Path]):
    boxes = "[...document.querySelectorAll('section')].map(e => { const b ="
    boxes += " e.getBoundingClientRect(); return [b.left, b.right, b.top, b.bottom]; })"
    for width, columns in ((800, 1), (1200, 1), (1600, 2)):
        chromium.open(pages["named_in_machine"], width=width)
        found = chromium.evaluate(boxes)
        assert len({round(left) for left, *_ in found}) == columns
        covered = max(right for _, right, *_ in found) - min(left for left, *_ in found)
        assert covered > min(0.9 * width, 1050 * columns)
        for a, b in combinations(found, 2):
            apart = a[0] >= b[1] - 1 or b[0] >= a[1] - 1
            assert apart or a[2] >= b[3] - 1 or b[2] >= a[3] - 1, (a, b)


def test_pictures_do_not_glare_in_the_dark(chromium: Browser, pages: dict[str, Path]):
    fills = "[...document.querySelectorAll('.heat')].map(e => getComputedStyle(e).fill)"
    for dark in (False, True):
        chromium.open(pages["named_in_machine"], dark=dark)
        light = [_luminance(fill) for fill in chromium.evaluate(fills)]
        assert (max(light) < 0.4) is dark
        # Each step of a scale differs from its neighbours, and from the first to the last goes on.
        scale = "[...document.querySelectorAll('svg[viewBox=\"0 0 276 30\"] .heat')]"
        steps = chromium.evaluate(f"{scale}.map(e => getComputedStyle(e).fill)")
        levels = [_luminance(fill) for fill in steps]
        assert levels == sorted(levels, reverse=not dark)
        assert len(set(levels)) == 7


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("kind", ["healthy", "verified"])
def test_text_contrast_in_both_schemes(
    chromium: Browser, pages: dict[str, Path], kind: str, dark: bool
):
    """At least 4.5 : 1, as WCAG 2 asks of text."""
    chromium.open(pages[kind], dark=dark)
    found = chromium.evaluate(COLOURS)
    assert len(found) > 50
    paper = {back for _, _, back in found}
    assert any(_luminance(back) < 0.1 for back in paper) is dark
    # Lines of pictures: at least 3 : 1, as it asks of graphics.
    strokes = "[...document.querySelectorAll('.rail, .bar, .thread, .whisker, .dial, .due')].map("
    strokes += "e => (s => [e.className.baseVal, s.stroke, s.strokeOpacity])(getComputedStyle(e)))"
    back = min(paper, key=_luminance) if dark else "rgb(255, 255, 255)"
    for name, stroke, opacity in chromium.evaluate(strokes):
        light, low = sorted((_luminance(stroke), _luminance(back)), reverse=True)
        assert (light + 0.05) / (low + 0.05) >= 3.0, name
        assert opacity == "1", name
    for tag, front, back in found:
        light, low = sorted((_luminance(front), _luminance(back)), reverse=True)
        assert (light + 0.05) / (low + 0.05) >= 4.5, (tag, front, back)


def _luminance(colour: str) -> float:
    values = np.array([float(v) for v in re.findall(r"[\d.]+", colour)[:3]]) / 255.0
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


def test_the_policy_stops_what_would_slip_through(chromium: Browser, tmp_path: Path):
    """Were something not escaped: the page's own policy lets neither scripts nor pictures in."""
    whole = html(documents()["few"]().page())
    slipped = tmp_path / "slipped.html"
    evil = "<script>document.title='owned'</script><img src='http://127.0.0.1:9/x.png'>"
    slipped.write_text(whole.replace("</main>", f"{evil}</main>"), encoding="utf-8")
    chromium.open(slipped)
    assert chromium.evaluate("document.title") != "owned"
    assert chromium.complaints()  # the violations
    assert not [e for e in chromium.of("Network.responseReceived") if "9/x" in str(e)]
