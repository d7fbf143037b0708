"""`orthocal guide`: from the name of a topic to its page, on a screen or in a pipe."""

import re

import pytest

from tests.cli.program import done, refused, run
from tests.guide.test_pages import PAGES
from tests.markdown import blocks


def on_screen(monkeypatch: pytest.MonkeyPatch, columns: int, *topic: str) -> str:
    """What a terminal of this width shows, without colours."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", str(columns))
    return re.sub(r"\x1b\[[0-9;]*m", "", done("guide", *topic))


def test_every_topic_is_laid_out_on_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, page in PAGES.items():
        shown = on_screen(monkeypatch, 80, name)
        assert max(map(len, shown.splitlines())) <= 80, name
        assert not re.search(r"\*\*|```", shown), name
        lines = [line.strip() for line in shown.splitlines()]
        code = [block for kind in ("text", "sh", "console") for block in blocks(page, kind)]
        broken = {line.strip() for block in code for line in block.splitlines()}.difference(lines)
        assert not broken, name


def test_a_wide_screen_is_not_used_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    def widest(columns: int) -> int:
        shown = on_screen(monkeypatch, columns, "signs")
        return max(len(line.rstrip()) for line in shown.splitlines())

    assert widest(60) <= 60 < 80 < widest(100) == widest(250) <= 100


@pytest.mark.parametrize(
    ("typed", "name"),
    [
        ((), "index"),
        (("What", "to", "do", "when"), "what-to-do-when"),
        (("what-to-do when",), "what-to-do-when"),
        (("AXIS-GAP",), "axis_gap"),
        (("axis gap",), "axis_gap"),
    ],
)
def test_a_topic_however_it_is_written(typed: tuple[str, ...], name: str) -> None:
    assert run("guide", *typed).stdout == PAGES[name]


@pytest.mark.parametrize(
    ("typed", "near"),
    [("sings", "signs"), ("gap", "axis_gap"), ("backlsh", "backlash"), ("leg", "leg_length")],
)
def test_of_an_unknown_topic_the_nearest_are_named(typed: str, near: str) -> None:
    assert near in re.split(r"[ ,.]+", refused(2, "guide", typed).partition("Nearest: ")[2])


@pytest.mark.parametrize("typed", ["", "xyzzy", "../causes", "/etc/passwd", "\x1b[31mred"])
def test_what_is_near_nothing_is_refused_all_the_same(typed: str) -> None:
    said = refused(2, "guide", typed)
    assert "All pages: orthocal guide" in said
    assert "\x1b" not in said
