"""The report on a terminal of 80 columns, and as Markdown."""

from __future__ import annotations

import io

import pytest
from rich.cells import cell_len
from rich.console import Console

from orthoglide_cal.report.blocks import Document, Facts, Figure, Given, Notice, Section, Table
from orthoglide_cal.report.markdown import markdown
from orthoglide_cal.report.shown import in_csv, in_markdown, visible
from orthoglide_cal.report.terminal import renderable
from tests.report.cases import documents

KINDS = tuple(documents())


def shown(document: Document, width: int = 80, colour: bool = False) -> str:
    file = io.StringIO()
    Console(
        file=file, width=width, highlight=False, markup=False, emoji=False,
        force_terminal=colour, color_system="standard" if colour else None,
    ).print(renderable(document))  # fmt: skip
    return file.getvalue()


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_wider_than_80_columns(kind):
    text = shown(documents()[kind]())
    assert max(cell_len(line) for line in text.splitlines()) <= 80
    assert "…" not in text.replace(" … ", "") or kind == "hostile"


@pytest.mark.parametrize("kind", KINDS)
def test_every_format_says_the_same(kind):
    """Each section's title, each table cell and each finding is in all of them."""
    document = documents()[kind]()
    terminal = "".join(shown(document, width=2000).split())
    text = "".join(markdown(document).split())
    wanted = [document.notice.title]
    for section in (*document.sheet, *document.sections):
        wanted.append(section.title)
        for block in section.blocks:
            if isinstance(block, Table):
                cells = (c for row in block.rows for c in row if isinstance(c, str))
                wanted += [*cells, *block.head]
            elif isinstance(block, Figure):
                wanted.append(block.finding)
    for words in wanted:
        assert "".join(words.split()) in terminal, words
        assert "".join(in_markdown(words).split()) in text, words


def test_colour_is_never_the_only_sign():
    plain = shown(documents()["ambiguous"]())
    assert "✘ Do not enter these offsets" in plain
    assert "\x1b" not in plain
    assert "\x1b[" in shown(documents()["ambiguous"](), colour=True)


def test_hostile_texts_cannot_steer_the_terminal():
    text = shown(documents()["hostile"]())
    assert not set(text) & set("\x1b\x07\u009b\u202e\u2066")
    assert "⟨U+001B⟩[31mred" in text
    assert "<script>alert('x')</script>" in text


def test_hostile_texts_stay_texts_in_markdown():
    text = markdown(documents()["hostile"]())
    assert "<script" not in text.replace("\\<script", "")
    assert "](" not in text.replace("\\](", "").replace("`code`[link](", "")
    assert "http://example.invalid" not in "".join(
        part for k, part in enumerate(text.split("``")) if k % 2 == 0
    )
    assert not set(text) & set("\x1b\x07\u009b\u202e\u2066")
    # Every row of a table has as many cells as its head: nothing breaks out of one.
    lines = text.splitlines()
    for k, line in enumerate(lines):
        if line.startswith("|---") or line.startswith("|:--"):
            columns = line.count("|")
            rows = lines[k + 1 :]
            for row in rows[: next(n for n, r in enumerate(rows) if not r.startswith("|"))]:
                assert row.replace("\\|", "").count("|") == columns


def test_blank_fields_are_lines_to_write_on():
    document = Document(
        kind="Report", title="m", number="N-1", facts=Facts((("Operator", None),)),
        notice=Notice("info", "t"), sheet=(), signatures=("Checked by",),
        sections=(Section("s", (Table(("a", "b"), (("x", None),)),)),),
    )  # fmt: skip
    assert "Operator  ____" in shown(document)
    assert "Checked by, date: ____" in shown(document)
    assert "- Operator: \\_\\_" in markdown(document)


def test_visible_keeps_words_and_shows_controls():
    assert visible("a\tb\nc") == "a b c"
    assert visible("x\u202ey\u200fz\x00") == "x⟨U+202E⟩y⟨U+200F⟩z⟨U+0000⟩"
    assert visible("\x9b\ud800\ue000\u2028\ufeff\U000e0001") == (
        "⟨U+009B⟩⟨U+D800⟩⟨U+E000⟩⟨U+2028⟩⟨U+FEFF⟩⟨U+E0001⟩"
    )
    assert visible("שלום, ünï – 30 °C, 日本") == "שלום, ünï – 30 °C, 日本"


@pytest.mark.parametrize(
    ("given", "written"),
    [
        ("=1+1", "'=1+1"),
        ("+49 30", "'+49 30"),
        ("-cmd|' /C calc'!A0", "'-cmd|' /C calc'!A0"),
        ("@SUM(A1)", "'@SUM(A1)"),
        ("\t=1", "' =1"),
        ("\r=1", "' =1"),
        ("  =1", "'  =1"),
        ("hall 3 = warm", "hall 3 = warm"),
        ("", ""),
    ],
)
def test_formulas_are_defused(given, written):
    assert in_csv(given) == written


def test_given_names_do_not_become_markup():
    document = Document(
        kind="Report", title="[bold]x[/bold]", number="N-1",
        facts=Facts((("Operator", Given("[red]A[/red] :smile:")),)),
        notice=Notice("info", "t"), sheet=(), sections=(),
    )  # fmt: skip
    assert "[bold]x[/bold]" in shown(document)
    assert "[red]A[/red] :smile:" in shown(document)
