"""A report as a list of blocks; the terminal, HTML and Markdown show the same ones."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from orthoglide_cal.report.markup import Html


@dataclass(frozen=True)
class Code:
    """Something to type or to compare letter by letter."""

    text: str


@dataclass(frozen=True)
class Strong:
    """The words that matter."""

    text: str


@dataclass(frozen=True)
class Given:
    """A name or note that somebody typed: shown as it is, never obeyed."""

    text: str


Inline = str | Code | Strong | Given
Line = Inline | tuple[Inline, ...]
Tone = Literal["good", "warn", "bad", "info"]


@dataclass(frozen=True)
class Paragraph:
    """One paragraph; `small` for explanations."""

    content: Line
    small: bool = False


@dataclass(frozen=True)
class Notice:
    """A coloured box; its sign and title say the tone without the colour."""

    tone: Tone
    title: str
    lines: tuple[Line, ...] = ()


@dataclass(frozen=True)
class Facts:
    """Name and value; None is shown as a line to write on."""

    rows: tuple[tuple[str, Line | None], ...]


@dataclass(frozen=True)
class Table:
    """A table of numbers.

    Attributes:
        head: column titles.
        rows: cells; None is shown as a line to write on.
        words: columns that hold words (left-aligned); numbers are right-aligned.
        caption: says what it shows.
        last_is_total: the last row is set off.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[Line | None, ...], ...]
    words: tuple[int, ...] = (0,)
    caption: str = ""
    last_is_total: bool = False


@dataclass(frozen=True)
class Figure:
    """A picture.

    Attributes:
        title: what it is; empty if its section's title says it.
        finding: what one sees in it, in words.
        panels: SVG parts that are laid out side by side as far as they fit.
        sketch: the same for the terminal, in characters; may be empty.
        columns: most panels beside each other.
        key: explanation of the marks.
        pairs: the panels are a first half and a second half, which are set side by side.
        legend: a further panel below all others.
    """

    title: str
    finding: str
    panels: tuple[Html, ...]
    sketch: tuple[str, ...] = ()
    columns: int = 3
    key: str = ""
    pairs: bool = False
    legend: Html | None = None


@dataclass(frozen=True)
class Step:
    """One thing to do, with what to type."""

    content: Line
    code: str = ""


@dataclass(frozen=True)
class Steps:
    """Things to do, in order."""

    items: tuple[Step, ...]


Block = Paragraph | Notice | Facts | Table | Figure | Steps


@dataclass(frozen=True)
class Section:
    """A titled part of the report; `beside` sets it beside the next one where there is room."""

    title: str
    blocks: tuple[Block, ...]
    beside: bool = False


@dataclass(frozen=True)
class Document:
    """A whole report.

    Attributes:
        kind: e.g. "Calibration report".
        title: of what, e.g. the machine's name.
        number: unique number; only letters, digits and "-".
        facts: the most important ones, under the title.
        notice: the answer in one box.
        sheet: what belongs on the first page, to be pinned to the machine.
        sections: the evidence, from the second page on.
        signatures: lines to sign on, at the end of the first page.
    """

    kind: str
    title: str
    number: str
    facts: Facts
    notice: Notice
    sheet: tuple[Section, ...]
    sections: tuple[Section, ...]
    signatures: tuple[str, ...] = field(default=())
