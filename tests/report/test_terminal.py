"""The documents on a terminal of 80 columns, and as Markdown."""

import io
import re
from collections.abc import Iterator

import pytest
from rich.cells import cell_len
from rich.console import Console

from orthoglide_cal.errors import visible, visible_lines
from orthoglide_cal.files.text import in_csv
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.markdown import in_markdown, markdown
from orthoglide_cal.report.terminal import terminal
from tests.report.cases import DOCUMENTS

KINDS = tuple(DOCUMENTS)
HARMFUL = set("\x1b\x07\u009b\u202e\u2066")
LONG = "orthocal diagnose '/a/long way/" + "x" * 200 + "/my data.csv'"


def shown(page: doc.Page, width: int = 80) -> str:
    file = io.StringIO()
    console = Console(file=file, width=width, highlight=False, markup=False, emoji=False)
    console.print(terminal(page, width), soft_wrap=True)
    return file.getvalue()


def of_blocks(*blocks: doc.Block) -> doc.Page:
    return doc.Page("Report", "m", sections=(doc.Section(None, *blocks),))


def blocks_of(page: doc.Page) -> Iterator[doc.Block]:
    yield from (block for block in (page.facts, page.notice) if block is not None)
    for section in (*page.sheet, *page.sections):
        yield from section.blocks


def lines_of(block: doc.Block) -> Iterator[doc.Line]:
    """Every line of a block but what stands in grids."""
    match block:
        case doc.Notice():
            yield from block.lines
        case doc.Facts():
            yield from (value for _, value in block.rows if value is not None)
        case doc.Instructions():
            yield from block.items
        case str() | tuple() | doc.Marked():
            yield block


def unwrapped(page: doc.Page) -> list[str]:
    """Commands and listed lines: what has to stay on its line."""
    found = []
    for block in blocks_of(page):
        parts = [part for line in lines_of(block) for part in doc.parts_of(line)]
        found += [part.text for part in parts if part and part.style in ("typed", "command")]
        if isinstance(block, doc.Listing):
            found += block.lines
    return [visible(text).strip() for text in found]


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_but_commands_and_listings_is_wider_than_80_columns(kind):
    """These are never wrapped, in a narrow terminal neither."""
    page = DOCUMENTS[kind]().page()
    kept = unwrapped(page)
    for line in shown(page).splitlines():
        assert cell_len(line) <= 80 or any(text in line for text in kept), line
        assert line == line.rstrip()
        cut = kind in ("hostile", "solved", "faulty")  # names from a file that fill a line
        assert "…" not in line.replace(" … ", "") or cut, line
    narrow = shown(page, 40).splitlines()
    for text in kept:
        assert any(text in line for line in narrow), text
    for line in (line for block in blocks_of(page) for line in lines_of(block)):
        said = "".join(p if isinstance(p, str) else "" for p in doc.parts_of(line))
        assert not re.search("orthocal [a-z]", said), "a command that may be wrapped"


@pytest.mark.parametrize(
    "block",
    [
        ("Run next: ", doc.typed(LONG)),
        doc.Instructions((doc.step("Do this " * 20, LONG),)),
        doc.Notice(doc.Tone.INFO, "title", (("x " * 60, doc.typed(LONG)),)),
        doc.Listing((f"    → {LONG}",)),
    ],
)
def test_a_command_of_any_length_stays_on_its_line(block):
    (line,) = (line for line in shown(of_blocks(block)).splitlines() if "orthocal" in line)
    assert line.endswith(LONG)
    assert shown(of_blocks(block), 30).count(LONG) == 1


@pytest.mark.parametrize("kind", KINDS)
def test_every_format_says_the_same(kind):
    """Each section's title, each table cell and each sketch's finding; and nothing steers them."""
    page = DOCUMENTS[kind]().page()
    on_screen, in_file = shown(page, width=5000), markdown(page)
    assert not set(on_screen + in_file) & HARMFUL
    terminal, text = ("".join(each.split()) for each in (on_screen, in_file))
    wanted = [section.title or "" for section in page.in_characters]
    for block in blocks_of(page):
        match block:
            case doc.Grid():
                cells = (cell for row in block.rows for cell in row)
                wanted += [cell for cell in (*cells, *block.head) if isinstance(cell, str)]
            case doc.Figure() if block.plain:
                wanted.append(block.title or "")
            case doc.Notice():
                wanted.append(block.title)
        wanted += [line for line in lines_of(block) if isinstance(line, str)]
    for words in wanted:
        assert "".join(visible(words).split()) in terminal, words
        assert "".join(in_markdown(words).split()) in text, words


@pytest.mark.parametrize("kind", ["hostile", "faulty"])
def test_hostile_texts_stay_texts_in_markdown(kind):
    text = markdown(DOCUMENTS[kind]().page())
    # Outside code, which nothing in it can end.
    prose, fence = [], None
    for line in text.splitlines():
        if line.startswith("```") and fence in (None, line):
            fence = None if fence else line.removesuffix("text")
        elif fence is None:
            prose.append("".join(part for k, part in enumerate(line.split("``")) if k % 2 == 0))
    said = "\n".join(prose)
    assert fence is None
    assert "<script" not in said.replace("\\<script", "")
    assert "](" not in said.replace("\\](", "")
    assert "http://example.invalid" not in said


def test_rows_of_markdown_have_as_many_cells_as_their_head():
    lines = markdown(DOCUMENTS["hostile"]().page()).splitlines()
    for k, line in enumerate(lines):
        if line.startswith("|---") or line.startswith("|:--"):
            columns = line.count("|")
            rows = lines[k + 1 :]
            for row in rows[: next(n for n, r in enumerate(rows) if not r.startswith("|"))]:
                assert row.replace("\\|", "").count("|") == columns


def test_the_rows_of_a_wide_table_become_sentences():
    head = ("leg", *(f"posture {k}" for k in range(20)))
    rows = tuple((f"leg {axis}", *(f"{axis}{k:08d}" for k in range(20))) for axis in "xyz")
    lines = shown(of_blocks(doc.Grid(head, rows))).splitlines()
    assert max(map(len, lines)) <= 80
    listed = [" ".join(part.split()) for part in "\n".join(lines).split("leg ")[1:]]
    for part, (name, *cells) in zip(listed, rows, strict=True):
        named = zip(head[1:], cells, strict=True)
        assert f"leg {part}" == f"{name}: {', '.join(map(' '.join, named))}"
    # One that fits stays as it is.
    narrow = shown(of_blocks(doc.Grid(head[:3], tuple(row[:3] for row in rows))))
    assert "leg    posture 0  posture 1" in narrow


def test_what_is_typed_stands_behind_its_sentence_where_both_fit():
    def steps(width: int) -> list[str]:
        item = doc.step("Measure again", "orthocal measure after.yaml")
        page = doc.Page("k", None, sections=[doc.Section("Next", doc.Instructions([item]))])
        return shown(page, width).splitlines()[1:]

    command = "orthocal measure after.yaml"
    assert steps(80) == [f"{'  1. Measure again':46}{command}"]
    assert steps(60) == [f"{'  1. Measure again':33}{command}"]
    assert steps(44) == ["  1. Measure again", f"     {command}"]


def test_columns_of_words_are_wrapped_before_numbers_move():
    grid = doc.Grid(("what", "n"), (("many words " * 12, "1.25"), ("few", "-3.50")))
    lines = shown(of_blocks(grid)).splitlines()
    assert max(map(len, lines)) <= 80
    first, last = (line for line in lines if "1.25" in line or "-3.50" in line)
    assert len(first) == len(last)


def test_a_picture_that_characters_cannot_show_is_left_out():
    drawn = doc.Figure((), title="Residuals", plain=["Worst fits x.", doc.Listing(["x ██"])])
    page = of_blocks(doc.Figure((), title="Where gauges stood"), drawn)
    assert shown(page) == "Report: m\n\nWorst fits x.\nx ██\n\n"
    assert "gauges" not in markdown(page)
    assert "Worst fits x." in markdown(page)


def test_what_is_printable_has_nothing_to_hide():
    printable = "".join(filter(str.isprintable, map(chr, range(0x110000))))
    assert visible(printable) == printable


def test_visible_keeps_words_and_shows_controls():
    assert visible("a\tb\nc") == "a b c"
    assert visible_lines("a\x1b\nb\tc") == "a⟨U+001B⟩\nb c"
    assert visible("x\u202ey\u200fz\x00") == "x⟨U+202E⟩y⟨U+200F⟩z⟨U+0000⟩"
    assert visible("\x9b\ud800\ue000\u2028\ufeff\U000e0001") == (
        "⟨U+009B⟩⟨U+D800⟩⟨U+E000⟩⟨U+2028⟩⟨U+FEFF⟩⟨U+E0001⟩"
    )
    assert visible("שלום, ünï – 30 °C, 日本") == "שלום, ünï – 30 °C, 日本"


@pytest.mark.parametrize(
    ("given", "written"),
    [
        ("=1+1", "'=1+1"), ("+49 30", "'+49 30"), ("-cmd|' /C calc'!A0", "'-cmd|' /C calc'!A0"),
        ("@SUM(A1)", "'@SUM(A1)"), ("\t=1", "' =1"), ("\r=1", "' =1"), ("  =1", "'  =1"),
        ("hall 3 = warm", "hall 3 = warm"), ("", ""),
    ],
)  # fmt: skip
def test_formulas_are_defused(given, written):
    assert in_csv(given) == written


def test_backticks_in_listed_lines_do_not_end_the_listing():
    text = markdown(of_blocks(doc.Listing(("```", "# not a heading"))))
    assert "````text\n```\n# not a heading\n````" in text
