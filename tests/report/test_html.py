"""The page without a browser: well-formed, self-contained, complete."""

import re
from dataclasses import replace
from html import escape
from html.parser import HTMLParser

import pytest

from orthoglide_cal.model.machine import Details
from orthoglide_cal.report.document import MARK
from orthoglide_cal.report.html import html
from orthoglide_cal.report.markdown import markdown
from tests.report.cases import DOCUMENTS, changed, report_of
from tests.results import cases
from tests.results.cases import identity_of

VOID = {"meta", "link"}


class Outline(HTMLParser):
    """Checks nesting; collects tags, attributes and text."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str, str | None]] = []
        self.words: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, name, value) for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.words.append(data)


def outlined(page: str) -> Outline:
    outline = Outline()
    outline.feed(page)
    assert outline.open == []
    return outline


@pytest.fixture(scope="module", params=tuple(DOCUMENTS))
def made(request: pytest.FixtureRequest) -> tuple[str, str, Outline]:
    whole = html(DOCUMENTS[request.param]().page())
    return request.param, whole, outlined(whole)


def test_nothing_runs_and_nothing_is_fetched(made):
    _, whole, outline = made
    assert not {"script", "img", "iframe", "object", "a", "form", "base"} & set(outline.tags)
    for name, attribute, value in outline.attributes:
        assert not attribute.startswith("on")
        assert attribute != "style"
        if attribute in ("src", "href", "xlink:href"):
            assert (name, value) == ("link", "data:,")
    style = re.search("<style>(.*?)</style>", whole, re.DOTALL)[1]
    assert not re.search(r"url\(|@import|https?:", style)


def test_every_picture_says_what_one_sees(made):
    _, whole, _ = made
    for picture in re.findall("<svg.*?</svg>", whole, re.DOTALL):
        (finding,) = re.findall('role="img"[^>]*><title>[^<]+</title><desc>([^<]+)', picture)
        assert len(finding.split()) > 3


def test_hostile_texts_are_shown_as_texts():
    outline = outlined(html(DOCUMENTS["hostile"]().page()))
    text = "".join(outline.words)
    assert text.count("<script>alert('x')</script>") >= 3
    assert "<img src=x onerror=alert(1)>&amp;" in text
    assert "W" * 400 in text
    assert "שלום עולם مرحبا" in text
    assert "invoice⟨U+202E⟩gnp.exe⟨U+2066⟩⟨U+001B⟩[31mred" in text
    assert not set(text) & set("\u202e\u2066\x1b\x07\u009b")


def test_every_page_carries_number_and_count(made):
    name, whole, outline = made
    page = DOCUMENTS[name]().page()
    assert f'"{page.name}"' in whole
    assert "counter(page)" in whole
    assert "counter(pages)" in whole
    assert (page.number or page.kind) in " ".join(outline.words)


def test_captions_do_not_scroll_and_no_heading_stands_over_nothing(made):
    _, whole, _ = made
    for scrolled in re.findall(r'<div class="scroll".*?</div>', whole, re.DOTALL):
        assert "<p" not in scrolled
    assert not re.search(r"<section>(<h2>[^<]*</h2>)?</section>", whole)


def test_a_report_is_no_certificate(made):
    """Only a gauge has a certificate; the word "accredited" is nowhere."""
    name, _, outline = made
    words = " ".join(outline.words).lower()
    assert "accredited" not in words
    if name not in ("failed", "hostile", "healthy", "as_left"):
        assert words.count("certificate") <= 1


def test_a_healthy_report_has_everything_that_a_laboratory_would_state():
    page, answer = report_of(cases.healthy()).page(), cases.healthy().answer
    outline = outlined(html(page))
    words = " ".join(" ".join(outline.words).split())
    assert 51 < answer.dof < 500
    titles = (section.title or "" for section in (*page.sheet, *page.sections))
    for wanted in (
        *titles, f"k = {answer.k:.2f}", f"{answer.dof} effective degrees of freedom", "95 %",
        "A. Martin", "2026-03-03 09:31 +01:00", "20.9 °C at the start, 21.3 °C at the end",
        "hall 3", "no. 41", "2026-0117", "due 2027-01-31", "touched the stand",
        identity_of(cases.healthy()).number, "0" * 64, "orthocal 0.", "Measured by, date",
        "reproduce it only in full",
    ):  # fmt: skip
        assert wanted in words, wanted


@pytest.mark.parametrize("make", [cases.healthy, cases.failed])
def test_what_the_owner_wrote_is_printed_and_nothing_else(make):
    written = {
        "Organisation": "Milling & Sons", "Place": "Nantes", "Serial number": "OG-17",
        "Customer": "A <b>", "Method": "instruction 12", "Traceability": "PTB",
        "Authorised by": "B. Petit", "Gauge due": "2027-01-31",
    }  # fmt: skip
    bare = html(report_of(make()).page())
    # To what the gauges are traced is asked for on every report.
    asked = [name for name in written if f"<dt>{name}</dt>" in bare]
    assert asked == ["Traceability"]
    assert '<dt>Traceability</dt><dd><span class="blank"' in bare
    given = make().given
    details = {name.lower().replace(" ", "_"): text for name, text in written.items()}
    model = changed(given.model, report=Details(**details))
    whole = html(report_of(replace(make(), given=replace(given, model=model))).page())
    for name, text in written.items():
        assert f"<dt>{name}</dt><dd><bdi>{escape(text)}</bdi></dd>" in whole
    # Who and which stands at its head, how among the conditions.
    head, _, _ = whole.partition("<main>")
    assert "Milling &amp; Sons" in head
    assert "instruction 12" not in head
    assert "<div>Authorised by B. Petit, date</div>" in whole


@pytest.mark.parametrize("name", ["healthy", "failed"])
def test_a_numbered_report_says_for_what_it_holds_and_where_it_ends(name: str):
    page = DOCUMENTS[name]().page()
    outline = outlined(html(page))
    said = " ".join(outline.words)
    assert "The results relate only to the machine" in said
    assert said.endswith(f"End of report {page.number}.")
    assert markdown(page).endswith(f"End of report {page.number}.\n\n{MARK}")


def test_what_was_not_given_is_a_blank_line():
    outline = outlined(html(report_of(cases.ambiguous()).page()))
    blanks = [value for _, name, value in outline.attributes if value == "not given"]
    # Measured, gauges, temperature, operator; protocol, started; traceability.
    assert len(blanks) == 7
