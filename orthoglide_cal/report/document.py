"""A result as a command shows it: plain values for programs, and a page of blocks for people.

The renderers of a page know nothing of what it is about. It and its pictures are marked up by `tag`
and `join`, which escape all but their own.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from html import escape
from typing import Literal, Self

from orthoglide_cal.errors import visible
from orthoglide_cal.words import SIMULATED

# The last line of every page that is written to a file: such a file may be written again.
MARK = "<!-- Written by orthocal -->\n"
BLANK = "_" * 12  # to write on

# --- markup -----------------------------------------------------------------------------------


class Html(str):
    """Markup; made by `tag` and `join`, or of constants; never of text from outside."""

    __slots__ = ()


def join(parts: Iterable[str | None], between: str = "") -> Html:
    """Parts one after the other; plain strings among them are escaped, None is left out."""
    every = (part for part in parts if part is not None)
    # A name or a note may hold signs that HTML obeys, and others that nobody sees.
    return Html(between.join(p if isinstance(p, Html) else escape(visible(p)) for p in every))


def tag(name: str, /, *children: str | None, **attributes: str | float | None) -> Html:
    """An element; children and attributes that are None are left out.

    In names of attributes a trailing "_" is dropped, others become "-" ("stroke_width", "class_").
    """
    written = ""
    for key, value in attributes.items():
        if value is not None:
            number = isinstance(value, float)
            content = f"{value:.2f}".rstrip("0").rstrip(".") if number else str(value)
            written += f' {key.rstrip("_").replace("_", "-")}="{join([content])}"'
    return Html(f"<{name}{written}>{join(children)}</{name}>")


# --- words of a page ------------------------------------------------------------------------------

Style = Literal[
    "plain", "code", "typed", "command", "strong", "doubtful", "given", "small", "blank"
]


@dataclass(frozen=True)
class Marked:
    """Words in a style.

    code: to compare letter by letter; typed: to type, on one line however long it is, at the end
    of its sentence; command: the same, set apart from it; strong: the words that matter; doubtful:
    words to beware of; given: a name or note that somebody typed, shown as it is, never obeyed;
    small: an explanation in small print.
    """

    style: Style
    text: str


code, typed = partial(Marked, "code"), partial(Marked, "typed")
strong, doubtful = partial(Marked, "strong"), partial(Marked, "doubtful")
given, small = partial(Marked, "given"), partial(Marked, "small")

Inline = str | Marked
Line = Inline | tuple[Inline, ...]
# None is shown as a line to write on.
Blank = Line | None


def step(sentence: str, command: str | None = None) -> Line:
    """One thing to do, with what to type."""
    return sentence if command is None else (sentence, Marked("command", command))


def parts_of(content: Blank) -> tuple[Marked, ...]:
    """The parts of a line, however it was given; mere text has the style "plain"."""
    content = Marked("blank", BLANK) if content is None else content
    parts = content if isinstance(content, tuple) else (content,)
    return tuple(Marked("plain", part) if isinstance(part, str) else part for part in parts)


class Tone(StrEnum):
    """Meaning of a notice; its sign tells it without the colour."""

    GOOD = "good"
    WARN = "warn"
    BAD = "bad"
    OPEN = "open"
    INFO = "info"

    @property
    def sign(self) -> str:
        """Begins the title; "" of what is no decision."""
        return {"good": "✔ ", "warn": "! ", "bad": "✘ ", "open": "? ", "info": ""}[self]


@dataclass(frozen=True)
class Notice:
    """The verdict; on a terminal with what it is about, `aside`, at the end of its line."""

    tone: Tone
    title: str
    lines: tuple[Line, ...] = ()
    aside: str = ""


@dataclass(frozen=True)
class Facts:
    """Name and value."""

    rows: Sequence[tuple[str, Blank]]


@dataclass(frozen=True)
class Grid:
    """A table; its columns of words are left-aligned and may be wrapped, numbers right-aligned.

    With `tiles` it holds the few numbers of the page that are read from afar: where there is room,
    each row is a tile with the first cell as its name, the last as its value, the others below.
    """

    head: Sequence[str]  # not shown if all are empty
    rows: Sequence[Sequence[Blank]]
    words: Sequence[int] = (0,)
    caption: str | None = None
    tiles: bool = False

    @classmethod
    def of(
        cls,
        columns: Mapping[str, Sequence[Blank]],
        words: Sequence[int] = (0,),
        caption: str | None = None,
        tiles: bool = False,
    ) -> Self:
        """A table of columns under their titles."""
        return cls([*columns], [*zip(*columns.values(), strict=True)], words, caption, tiles)


@dataclass(frozen=True)
class Figure:
    """A picture: SVG parts that are laid out side by side as far as they fit."""

    panels: Sequence[Html]
    columns: int = 3  # most side by side; 0: half as wide as a page, beside the other blocks
    key: str | None = None  # explanation of the marks
    title: str | None = None  # None if its section's title says it
    plain: "Sequence[Block]" = ()  # the same in characters


@dataclass(frozen=True)
class Instructions:
    """Things to do, in order."""

    items: Sequence[Line]


@dataclass(frozen=True)
class Listing:
    """Lines that stay lines, with their indentation, however long they are."""

    lines: Sequence[str]


# A line alone is a paragraph.
Block = Line | Notice | Facts | Grid | Figure | Instructions | Listing


@dataclass(init=False)
class Section:
    """A part of the document; it is not shown without blocks, nor is a table without rows."""

    title: str | None
    blocks: list[Block]

    def __init__(self, title: str | None, *blocks: Block | None) -> None:
        self.title = title
        shown = (block for block in blocks if not isinstance(block, Grid) or block.rows)
        self.blocks = [block for block in shown if block is not None]


def next_steps(steps: Iterable[Line], *more: Block | None) -> Section:
    """Next steps, in order; without any only what stands below them."""
    steps = tuple(steps)
    return Section("Next" if steps else None, Instructions(steps) if steps else None, *more)


@dataclass(frozen=True, eq=False)
class Page:
    """All that people are shown of one result."""

    kind: str  # e.g. "Calibration report"
    title: str | None = None  # of what, e.g. the machine's name; None: no heading on a terminal
    number: str | None = None  # unique; only letters, digits and "-"
    facts: Facts | None = None  # the most important ones, under the title
    notice: Notice | None = None  # the answer in one box
    sheet: Sequence[Section] = ()  # what belongs on the first page, to be pinned to the machine
    sections: Sequence[Section] = ()  # the evidence, from the second page on
    signatures: Sequence[str] = ()  # lines to sign on, at the end of the first page
    scope: str | None = None  # for what it holds; stands at its end
    simulated: bool = False  # no machine was measured

    @property
    def stamp(self) -> str | None:
        """The first line, its first word also across a printed page; None for measured ones."""
        return SIMULATED if self.simulated else None

    @property
    def in_characters(self) -> Iterator[Section]:
        """The sections but figures only drawn: their words would refer to nothing."""
        for part in (*self.sheet, *self.sections):
            kept = [b for b in part.blocks if not isinstance(b, Figure) or b.plain]
            if kept:
                yield Section(part.title, *kept)

    @property
    def closing(self) -> tuple[str, ...]:
        """The last lines: nobody can take a part of a numbered page for the whole."""
        end = f"End of report {self.number}." if self.number else None
        return tuple(filter(None, (self.scope, end)))

    @property
    def name(self) -> str:
        return f"{self.kind} {self.number}" if self.number else self.kind


@dataclass(frozen=True)
class Document:
    """One result, for programs and for people; what nobody asks for is not made."""

    data: Callable[[], Mapping[str, object]]  # the plain values that `--json` prints
    page: Callable[[], Page]  # everything that people may want to see
    screen: Callable[[], Page] | None = None  # one screen of a terminal; None: the page is short
