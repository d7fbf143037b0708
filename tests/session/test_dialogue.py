"""The loop, driven without a terminal: screens, keys, questions; resumed, ended early, reopened."""

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orthoglide_cal.errors import UsageError
from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.readings import session_json
from orthoglide_cal.model.machine import Origin
from orthoglide_cal.planning.steps import Posture
from orthoglide_cal.results.making import answer_to
from orthoglide_cal.session.asking import Asker, Style
from orthoglide_cal.session.dialogue import Dialogue, Quit
from orthoglide_cal.session.events import Doubt, Retake

from .going_on import events_of
from .virtual import (
    DOUBLE,
    a_dialogue,
    answered,
    offsets,
    opened,
    readings_of,
    steps_of,
    typed,
    values,
)


def content(dialogue: Dialogue) -> dict[str, Any]:
    return session_json(dialogue.so_far.session)


def replaced(dialogue: Dialogue) -> list[float]:
    """Readings that do not count any more [mm]."""
    return [take.value_mm for take, _ in dialogue.state.replaced]


def test_a_drive_takes_longer_than_turning_to_the_other_gauge(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drives: list[bool] = []
    monkeypatch.setattr(Asker, "rest", lambda _, driving: drives.append(driving))
    lines = [*typed(readings_of(steps_of()))[:4], "55.5"]  # beyond the gauge's travel: a question
    answered(tmp_path / "s.journal", lines)
    assert drives == [False, True, False, True, False]


def test_a_value_beyond_the_gauges_range_is_not_kept(tmp_path: Path) -> None:
    """Neither by a key nor by being typed twice."""
    lines = typed(readings_of(steps_of()))[:5]
    typed_again = [*lines[:4], "55.5", "k", "55.5", "55.5", lines[4]]
    dialogue, screen = answered(tmp_path / "s.journal", typed_again)
    assert replaced(dialogue) == [55.5] * 3
    assert len(dialogue.state.accepted) == 5
    assert "Not kept" in screen.text
    assert "5. k keep" not in screen.text


def test_every_screenful_fits_24_lines(tmp_path: Path) -> None:
    """From the heading of a set-up to its first prompt, and the table and the help."""
    lines = [*typed(readings_of(steps_of()))[:20], "t", "?", "q"]
    _, screen = answered(tmp_path / "s.journal", lines)
    for part in screen.text.split("-- Set-up")[1:]:
        assert len(part[: part.index(" > ")].splitlines()) <= 12
    for part in re.split(r"\nStep [0-9]+ of 60", screen.text.split("-- Set-up 2")[0])[2:]:
        assert len(part.splitlines()) <= 10
    assert re.search(r"9\. Gauge Y .*\n   saved (\S+) mm   \(cycle 1: \S+ mm\)", screen.text)
    plain = [t for t, style in screen.shown if style is Style.PLAIN and t.count("\n") > 2]
    table, help_text = plain[-2:]
    assert 18 < len(table.splitlines()) <= 23
    assert 10 < len(help_text.splitlines()) <= 23
    assert all(f"\n  {key} " in help_text for key in "unstq?km")


def test_keys_are_words_too_and_minus_zero_is_zero(tmp_path: Path) -> None:
    dialogue, screen = answered(tmp_path / "s.journal", ["-0", "0.1", "UNDO", "help", "quit"])
    assert [item.take.value_mm for item in dialogue.state.accepted.values()] == [0.0]
    assert "saved 0.000 mm" in screen.text
    assert screen.text.count("Type the reading, e.g.") == 1
    assert "not a reading" not in screen.text


def test_one_uncertainty_from_the_first_posture_to_the_end(tmp_path: Path) -> None:
    """What is shown is U of the end, but for what is asked at the end only; it says so."""
    path = tmp_path / "s.journal"
    lines = typed(readings_of(steps_of(), 4))
    dialogue, screen = answered(path, lines, first=opened(temperature_c=35.0), until_mm=0.001)
    dialogue.publish()
    found = answer_to(read_input(str(dialogue.path)))
    sure = [line for line in found.budget if not line.possible]
    warmth = [line for line in sure if line.source == Origin.TEMPERATURE]
    assert warmth
    shown = screen.text.split("Offsets so far, 95 % if nothing else is wrong:\n")
    assert len(shown) > 20
    said = re.findall(r"([-+]\d\.\d+) ± (\d\.\d+)", shown[-1])
    offsets_mm, expanded_mm = np.array(said, dtype=float).T
    np.testing.assert_allclose(
        offsets_mm, [parameter.found for parameter in found.parameters], atol=6e-4
    )
    variance = np.sum([np.square(line.std) for line in sure], axis=0)
    np.testing.assert_allclose(expanded_mm, found.k * np.sqrt(variance), atol=6e-4)
    # Without the warmth it would be half as large.
    without = variance - np.sum([np.square(line.std) for line in warmth], axis=0)
    assert (expanded_mm > 1.5 * found.k * np.sqrt(without)).all()


@pytest.mark.parametrize(("until", "least"), [(0.04, 12), (0.0261, 2)])
def test_until_ends_early_with_the_closing_posture(
    tmp_path: Path, until: float, least: int
) -> None:
    right = readings_of(steps_of(), 2)

    def answers() -> Iterator[str]:
        while dialogue.so_far.left:
            step = dialogue.so_far.left[0]
            yield f"{right[step.number - 1]:.2f}"

    dialogue, _, stack = a_dialogue(tmp_path / "s.journal", answers(), until_mm=until)
    with stack:
        dialogue.run()
        state = dialogue.state
    assert set(state.dropped.values()) == {state.ended.reason}
    assert len(state.dropped) >= least
    assert len(state.accepted) + len(state.dropped) == 60
    assert dialogue.so_far.steps[-1].posture is Posture.ISO
    # The closing reading may widen it a little.
    expanded = dialogue.so_far.expanded_mm
    assert 0.5 * until < expanded.max() <= 1.2 * until


def test_until_never_leaves_a_leg_out(tmp_path: Path) -> None:
    """However generous, every leg, gauge and posture is measured once."""
    lines = typed(readings_of(steps_of(), 2))
    dialogue, _ = answered(tmp_path / "s.journal", lines, until_mm=50.0)
    measured = {step.cell for step in dialogue.so_far.steps}
    assert measured == {step.cell for step in dialogue.setting.steps}
    assert len(dialogue.so_far.steps) < 60


# ---- keys


def test_retake_asks_for_that_step_then_returns(tmp_path: Path) -> None:
    right = typed(readings_of(steps_of()))
    lines = [*right[:8], "r 7 dial not read straight", right[6], right[8]]
    dialogue, _ = answered(tmp_path / "s.journal", lines)
    assert list(values(dialogue)) == [1, 2, 3, 4, 5, 6, 8, 7, 9]
    rows = content(dialogue)["retaken"]
    assert [(row["cycle"], row["reason"]) for row in rows] == [(2, "dial not read straight")]


def test_retake_of_a_leg_whose_stand_has_moved_is_the_whole_set_up(tmp_path: Path) -> None:
    right = typed(readings_of(steps_of()))
    dialogue, _ = answered(tmp_path / "s.journal", [*right[:42], "r 3", "n"])
    assert len(values(dialogue)) == 42
    dialogue, _ = answered(tmp_path / "s.journal", ["r", "r 3", "y"])
    # Leg Y was complete and stays; the stands of leg Z have to be moved for leg X.
    assert sorted(values(dialogue)) == list(range(21, 41))
    assert len(replaced(dialogue)) == 22
    again, _ = answered(tmp_path / "t.journal", [*right[:22], "r x", "y"])
    assert values(again) == {}


def test_notes_stay_with_their_step(tmp_path: Path) -> None:
    lines = ["n door \x1b[A\u202eslammed", "-0.64", "n", "second note", "n"]
    dialogue, _ = answered(tmp_path / "s.journal", lines)
    file = content(dialogue)
    assert file["readings"][0]["note"] == "door ⟨U+001B⟩[A⟨U+202E⟩slammed"
    assert file["environment"]["notes"] == "step 2: second note"


def test_skip_needs_a_reason(tmp_path: Path) -> None:
    keys = ["-0.64", "s", "", "s", "0.41", "s", " ", "s", "undo"]
    dialogue, _ = answered(tmp_path / "s.journal", keys)
    assert dict(dialogue.state.skipped) == {}
    dialogue, _ = answered(tmp_path / "s.journal", ["s cable in the way", "s", "still there"])
    assert dict(dialogue.state.skipped) == {2: "cable in the way", 3: "still there"}
    skipped = content(dialogue)["skipped"]
    assert [(row["leg"], row["direction"], row["posture"]) for row in skipped] == [
        ("x", "z", "iso"),
        ("x", "y", "max"),
    ]


def test_resuming_says_that_the_stands_are_in_place(tmp_path: Path) -> None:
    path = tmp_path / "s.journal"
    _, screen = answered(path, ["-0.64", "q"])
    before = len(screen.text.splitlines())
    _, screen = answered(path, ["q"])
    assert "do not touch" in screen.text
    assert len(screen.text.splitlines()) < before
    _, screen = answered(path, ["0.41", "r x"])
    assert screen.text.count("do not touch") == 1  # nothing counts any more: set it up again


@pytest.mark.parametrize(
    "line",
    ["", "911", "\x1b[A", "urr", "k", "t", "ß0.64", "r 59", "r -1", "r abc", "r 0", "r z", "r"],
)
def test_what_is_no_reading_and_no_key_changes_nothing(tmp_path: Path, line: str) -> None:
    dialogue, screen = answered(tmp_path / "s.journal", ["-0.64", line, line])
    assert values(dialogue) == {1: -0.64}
    assert dialogue.state.count == 2
    assert "\x1b" not in screen.text


def test_hostile_lines_at_every_kind_of_prompt(tmp_path: Path) -> None:
    """Random keys and rubbish for a long time: no crash, and the journal replays to the state."""
    rng = np.random.default_rng(8)
    words = [
        "u", "r 1", "r x", "r 3 why", "n hello", "n", "s all", "s no", "t", "p", "?", "k", "m",
        "y", "", "0.12", "-0.3", "1000000", "1e9", "ß0.3", "911", "\x00", "\u202e", "r",
        "s", "0.125", "12.3", "u u", "n " + "x" * 500, "−0,5 mm", "0.01 in", "z", "x",
    ]  # fmt: skip
    path = tmp_path / "s.journal"
    for _ in range(6):
        lines = [words[int(rng.integers(len(words)))] for _ in range(60)]
        dialogue, screen, stack = a_dialogue(path, lines)
        with stack:
            if dialogue.state.ended is not None:
                break
            with contextlib.suppress(EOFError, Quit):
                dialogue.run()
        again, _, stack = a_dialogue(path, [])
        stack.close()
        assert again.state == dialogue.state
        assert max(len(line) for line in screen.text.splitlines()) < 80
        assert all(c.isprintable() or c == "\n" for c in screen.text)


# ---- questions


def with_slip() -> list[str]:
    """Typed readings up to step 9, whose dial was read one revolution off."""
    right = readings_of(steps_of(), 1)
    return [*typed(right)[:8], f"{right[8] + 1.0:.2f}"]


@pytest.mark.parametrize("key", ["k", "K", "yes", "m"])
def test_a_slip_can_be_kept_with_a_note(tmp_path: Path, key: str) -> None:
    """Also after a crash: the question is put again."""
    path = tmp_path / "s.journal"
    answered(path, with_slip())
    dialogue, screen = answered(path, [key])
    assert Style.QUESTION in [style for _, style in screen.shown]
    assert dialogue.state.pending is None
    take = dialogue.state.accepted[9].take
    row = content(dialogue)["readings"][8]
    assert take.question in row["note"]
    assert row["reading_mm"] == float(with_slip()[-1])
    assert bool(dialogue.state.moved) == (key == "m")


@pytest.mark.parametrize(("off", "kept"), [(-1.0, True), (0.0, True), (0.01, True), (0.02, False)])
def test_a_slip_is_questioned_and_read_again(tmp_path: Path, off: float, kept: bool) -> None:
    """What is right by now is kept, and the same again without a second question: within three
    standard deviations of a reading, 0.0199 mm with this gauge."""
    lines = with_slip()
    again = f"{float(lines[-1]) + off:.2f}"
    dialogue, screen = answered(tmp_path / "s.journal", [*lines, again])
    ((take, _),) = dialogue.state.replaced
    assert (take.step, take.value_mm, take.doubt) == (9, float(lines[-1]), Doubt.REVOLUTION)
    assert take.question in " ".join(screen.text.split())
    assert take.question in content(dialogue)["retaken"][0]["reason"]
    assert values(dialogue).get(9) == (float(again) if kept else None)


@pytest.mark.parametrize("line", ["u", "t", "n what", "hello"])
def test_keys_work_at_a_question(tmp_path: Path, line: str) -> None:
    dialogue, _ = answered(tmp_path / "s.journal", [*with_slip(), line])
    assert (dialogue.state.pending is None) == (line == "u")
    assert sorted(values(dialogue)) == list(range(1, 9))


def test_a_moved_stand_gets_a_new_zero_and_the_offsets_stay_right(tmp_path: Path) -> None:
    right, steps = readings_of(steps_of(), 1), steps_of()
    knocked = [
        v + 0.5 if s.number >= 29 and s.cell.series == (1, 0) else v
        for s, v in zip(steps, right, strict=True)
    ]
    lines = typed(knocked)
    lines.insert(29, "m")
    dialogue, _ = answered(tmp_path / "s.journal", lines)
    assert dialogue.state.ended is not None
    assert [number for number, _ in dialogue.state.moved] == [29]
    take = dialogue.state.accepted[29].take
    assert "step 27" in take.question  # the last reading of that gauge
    labels = [
        r.get("gauge") for r in content(dialogue)["readings"] if r["leg"] + r["direction"] == "yx"
    ]
    assert labels == [None] * 4 + ["(moved at step 29)"] * 6
    healthy, _ = answered(tmp_path / "h.journal", typed(right))
    assert np.abs(offsets(dialogue) - offsets(healthy)).max() < 0.01


def test_a_clock_that_is_set_back_does_not_turn_the_order_around(tmp_path: Path) -> None:
    path = tmp_path / "s.journal"
    answered(path, ["-0.64", "0.41"], first=opened(DOUBLE))
    dialogue, _ = answered(path, ["-0.95"])  # its clock begins again
    minutes = dialogue.so_far.minutes
    assert np.all(np.diff(minutes) >= 0.0)
    assert minutes[0] > 0.0
    late = opened(at="2025-03-01T19:00:00.000+01:00")  # the clock shows 9 in the morning
    dialogue, _ = answered(tmp_path / "t.journal", ["-0.64"], first=late)
    assert dialogue.so_far.minutes.tolist() == [0.0]


RIGHT, SHORT = (typed(readings_of(steps_of(cycles=cycles))) for cycles in (3, 1))
ENDED = "the session was ended"


@pytest.mark.parametrize("answer", ["yes", "n", "0.41", "why"])
def test_s_all_ends_the_session_only_after_yes(tmp_path: Path, answer: str) -> None:
    clear = [] if answer in ("yes", "n") else ["n"]  # it is asked again until it is clear
    dialogue, screen = answered(tmp_path / "s.journal", ["-0.64", "s all", answer, *clear, "0.41"])
    assert screen.text.count("Type y or n.") == len(clear)
    assert "59 readings are missing." in screen.text
    assert ("End the session here? y/n > ", Style.PROMPT) in screen.shown
    ends = answer.startswith("y")
    assert (dialogue.state.ended is not None) == ends
    assert dialogue.state.skipped == dict.fromkeys(range(2, 61) if ends else (), ENDED)
    assert values(dialogue) == ({1: -0.64} if ends else {1: -0.64, 2: 0.41})


def reopened(path: Path, lines: list[str], agreed: bool = True) -> Dialogue:
    dialogue, _, stack = a_dialogue(path, lines, first=opened(cycles=1), agreed=agreed)
    with stack:
        dialogue.run()
        dialogue.publish()
    return dialogue


@pytest.fixture
def ended(tmp_path: Path) -> Path:
    """The journal of a session that was ended after 18 of 24 readings."""
    reopened(tmp_path / "s.journal", [*SHORT[:18], "s all power cut"])
    return tmp_path / "s.journal"


def test_an_ended_session_goes_on_where_it_was_ended(ended: Path) -> None:
    file = ended.with_suffix(".yaml")
    early = file.read_bytes()
    assert len(values(reopened(ended, [], agreed=False))) == 18  # nobody is asked there
    again = reopened(ended, SHORT[18:])
    assert values(again) == dict(enumerate(map(float, SHORT), start=1))
    assert again.state.ended is not None
    assert again.state.skipped == {}
    assert file.read_bytes() != early
    assert reopened(ended, []).state.ended is not None  # nothing is missing: nothing is asked


def test_a_session_file_that_somebody_changed_is_not_replaced(ended: Path) -> None:
    file = ended.with_suffix(".yaml")
    file.write_bytes(file.read_bytes() + b"# mine\n")
    before = file.read_bytes()
    with pytest.raises(UsageError, match="not overwritten"):
        reopened(ended, SHORT[18:])
    assert file.read_bytes() == before


def test_skipped_steps_of_another_set_up_bring_its_readings_with_them(tmp_path: Path) -> None:
    """The stands were moved since: leg X again, and leg Y, to which they come back."""
    path = tmp_path / "s.journal"
    answered(path, [*RIGHT[:9], "s cable", *RIGHT[10:25]])
    dialogue, screen, stack = a_dialogue(path, [], agreed=True)
    with stack:
        dialogue.offer_again()
    (retake,) = [e for e in events_of(path) if isinstance(e, Retake)]
    assert retake.steps == tuple(range(1, 26))
    assert "24 earlier readings are taken again" in " ".join(screen.text.split())
    first, _ = answered(tmp_path / "t.journal", [*RIGHT[:9], "s cable", *RIGHT[10:25], "r 10", "y"])
    assert values(first) == {}  # the key r does the same
