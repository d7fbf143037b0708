"""The pages in a real Chromium: silent, self-contained, fitting, readable."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.report.html import html
from tests.report.cases import documents
from tests.report.chromium import Browser, browser, find_chromium

PROGRAM = find_chromium()
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="there is no Chromium on this machine")

WIDTHS = (360, 800, 1600)
# Content of an A4 page with the margins of the style sheet, at 96 dots per inch.
A4_CONTENT = round((210 - 30) / 25.4 * 96)
KINDS = tuple(documents())
# Documents of the terminal, which draw their pictures in characters.
PLAIN = ("solved", "suspicious", "diagnosed", "undecided", "faulty", "reproduced")

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

PICTURES = """[...document.querySelectorAll('svg')].map(s => ({
  role: s.getAttribute('role'),
  named: s.getAttribute('aria-labelledby').split(' ').map(
    id => { const e = document.getElementById(id); return e && s.contains(e) ? e.textContent : ''; }
  ),
}))"""

# Colour of every text and of what lies behind it, as the browser computed them.
COLOURS = """(() => {
  const behind = e => {
    for (; e; e = e.parentElement) {
      const c = getComputedStyle(e).backgroundColor;
      if (c !== 'rgba(0, 0, 0, 0)') return c;
    }
    return 'rgb(255, 255, 255)';
  };
  return [...document.querySelectorAll('h1, h2, p, td, th, dt, dd, li, code, caption, footer')]
    .filter(e => e.textContent.trim() && !e.closest('svg'))
    .map(e => [e.tagName, getComputedStyle(e).color, behind(e)]);
})()"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    assert PROGRAM is not None
    with browser(PROGRAM) as running:
        yield running


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    files = {}
    for name, make in documents().items():
        files[name] = folder / f"{name}.html"
        files[name].write_text(html(make().page()), encoding="utf-8")
    return files


@pytest.mark.parametrize("kind", KINDS)
def test_page_is_silent_alone_and_fits(chromium: Browser, pages: dict[str, Path], kind: str):
    for width in WIDTHS:
        chromium.open(pages[kind], width=width)
        assert chromium.complaints() == []
        outside = [url for url in chromium.requests() if not url.startswith("data:")]
        assert outside == [pages[kind].as_uri()]
        assert chromium.evaluate(OVERFLOW) == [], width
        assert chromium.evaluate(CUT) == [], width


@pytest.mark.parametrize("kind", KINDS)
def test_every_picture_says_what_one_sees(chromium: Browser, pages: dict[str, Path], kind: str):
    chromium.open(pages[kind])
    pictures = chromium.evaluate(PICTURES)
    if kind not in ("failed", *PLAIN):
        assert pictures
    for picture in pictures:
        assert picture["role"] == "img"
        title, finding = picture["named"]
        assert title.strip()
        assert len(finding.split()) > 3
    ids = chromium.evaluate("[...document.querySelectorAll('[id]')].map(e => e.id)")
    assert len(ids) == len(set(ids))


@pytest.mark.parametrize("kind", KINDS)
def test_print_is_a4_with_numbered_pages(chromium: Browser, pages: dict[str, Path], kind: str):
    chromium.open(pages[kind])
    pdf = chromium.pdf()
    boxes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf)
    count = len(re.findall(rb"/Type /Page\b", pdf))
    assert 1 <= count <= (12 if kind == "hostile" else 7)
    for width, height in boxes:
        assert float(width) == pytest.approx(595.0, abs=1.0)
        assert float(height) == pytest.approx(842.0, abs=1.0)
    chromium.open(pages[kind], width=A4_CONTENT, media="print")
    assert chromium.evaluate(OVERFLOW) == []
    clipped = "[...document.querySelectorAll('.scroll')].filter(e => e.scrollWidth > %d).length"
    assert chromium.evaluate(clipped % (A4_CONTENT + 1)) == 0


def test_first_printed_page_holds_what_is_pinned_to_the_machine(
    chromium: Browser, pages: dict[str, Path]
):
    """Decision, what to do, offsets, as found and the lines to sign on: above the first break."""
    chromium.open(pages["healthy"], width=A4_CONTENT, media="print")
    end = chromium.evaluate("document.querySelector('.sign').getBoundingClientRect().bottom")
    assert end < (297 - 31) / 25.4 * 96


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("kind", ["healthy", "ambiguous", "few", "verified"])
def test_text_contrast_in_both_schemes(
    chromium: Browser, pages: dict[str, Path], kind: str, dark: bool
):
    """At least 4.5 : 1, as WCAG 2 asks of text."""
    chromium.open(pages[kind], dark=dark)
    found = chromium.evaluate(COLOURS)
    assert len(found) > 50
    paper = {back for _, _, back in found}
    assert any(_luminance(back) < 0.1 for back in paper) is dark
    for tag, front, back in found:
        light, low = sorted((_luminance(front), _luminance(back)), reverse=True)
        assert (light + 0.05) / (low + 0.05) >= 4.5, (tag, front, back)


def _luminance(colour: str) -> float:
    values = np.array([float(v) for v in re.findall(r"[\d.]+", colour)[:3]]) / 255.0
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


def test_hostile_texts_are_shown_as_texts(chromium: Browser, pages: dict[str, Path]):
    chromium.open(pages["hostile"])
    text = chromium.evaluate("document.body.textContent")
    assert text.count("<script>alert('x')</script>") >= 3
    assert "<img src=x onerror=alert(1)>&amp;" in text
    assert "W" * 400 in text
    assert "שלום עולם مرحبا" in text
    assert "invoice⟨U+202E⟩gnp.exe⟨U+2066⟩⟨U+001B⟩[31mred" in text
    assert not set(text) & set("\u202e\u2066\x1b\x07\u009b")
    assert chromium.evaluate("document.querySelectorAll('script, img, iframe, a').length") == 0


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
