"""The journal keeps every acknowledged record through anything, and no reading in it vanishes."""

import errno
import itertools
import os
from contextlib import ExitStack
from pathlib import Path

import pytest

from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.planning.steps import Order
from orthoglide_cal.session import events as journal_module
from orthoglide_cal.session.events import (
    RECORD,
    Answered,
    Arrived,
    Doubt,
    Ended,
    Event,
    GaugeLabel,
    Journal,
    Noted,
    Paused,
    Reopened,
    Retake,
    Shortened,
    Skipped,
    State,
    Taken,
    Undone,
    advance,
    encode,
    replay,
)

from .virtual import AT, opened, questioned, random_events, taken

HERE = Path(__file__).parent


def eventful() -> list[Event]:
    """A session in which everything happens that can."""
    strange = Noted(at=AT, step=3, text='µ ± 中 \u2028 line, "the" \\ technician\n')
    begun = opened(operator="Zoë", temperature_c=20.5)
    return [begun, taken(1, -0.64), strange, *random_events(19, 16)]


def written(events: list[Event]) -> tuple[bytes, list[int]]:
    """The journal's bytes and where each record ends."""
    data, checksum, ends = b"", 0, []
    for event in events:
        line, checksum = encode(event, checksum)
        data += line
        ends.append(len(data))
    return data, ends


@pytest.mark.parametrize("record", (HERE / "no_records.txt").read_text().splitlines())
def test_records_of_another_shape_are_refused(record: str) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        RECORD.validate_json(record)


def test_the_format_on_the_disk_is_that_of_version_1() -> None:
    """Byte for byte: every program that knows this version reads what another one wrote."""
    data = (HERE / "version_1.journal").read_bytes()
    events = Journal.decode(data, "j").events
    assert events == (
        opened(
            machine="name: µ\n", order=Order.FEWEST_MOVES, source=("simulated",), seed=7,
            gauges=(GaugeLabel(id="MT-1"), GaugeLabel(id="MT-2", certificate="C 7")),
        ),
        taken(1, -0.64, 0.25),
        questioned(taken(2, 1.43, 0.5), Doubt.SIGN, "gauge Z?").changed(about=1),
        Answered(at=AT, keep=True, moved=True),
        questioned(taken(3, 0.125, 0.75, "mahr:/dev/ttyUSB0"), Doubt.GRID, "mistyped?"),
        Answered(at=AT, keep=False),
        Undone(at=AT),
        Retake(at=AT, steps=(1, 2), reason="dust"),
        Skipped(at=AT, step=4, reason="cable"),
        Noted(at=AT, step=5, text="door"),
        Paused(at=AT, kind="paused"),
        Paused(at=AT, kind="continued"),
        Reopened(at=AT, source=("typed",)),
        Shortened(at=AT, drop=(6, 7), reason="known"),
        Ended(at=AT, reason="complete"),
    )  # fmt: skip
    assert written(list(events))[0] == data


def test_every_byte_of_every_last_record_cut_off() -> None:
    """After any record, the next one cut at any byte: exactly the records before it are there."""
    events = eventful()
    data, ends = written(events)
    states = [replay(events[: count + 1]) for count in range(len(events))]
    for count, (begin, end) in enumerate(itertools.pairwise(ends)):
        for cut in range(begin, end):
            found = Journal.decode(data[:cut], "j")
            # Only when nothing but the line end is missing the record is there already.
            expected = count + 1 if cut == end - 1 else count
            assert len(found.events) == expected + 1
            assert found.lost == (0 if cut == end - 1 else cut - begin)
            assert replay(found.events) == states[expected]


def test_a_power_loss_that_leaves_zeros_or_rubbish_is_a_cut() -> None:
    data, ends = written(eventful())
    for tail in (b"\0" * 300, b"\0", b'{"crc32":"00000000","record":{}}\n', b"\xff\xfe rubbish"):
        found = Journal.decode(data[: ends[4]] + tail, "j")
        assert list(found.events) == eventful()[:5]
        assert found.lost == len(tail)


@pytest.mark.parametrize("mask", [0x01, 0x80])
def test_any_changed_byte_before_the_last_record_is_noticed(mask: int) -> None:
    data, ends = written(eventful()[:4])
    for at in range(ends[-2]):
        changed = bytearray(data)
        changed[at] ^= mask
        with pytest.raises(InputError):
            Journal.decode(bytes(changed), "j")


def test_removed_and_exchanged_records_are_noticed() -> None:
    lines = written(eventful())[0].splitlines(keepends=True)
    with pytest.raises(InputError, match="line 3"):
        Journal.decode(b"".join(lines[:2] + lines[3:]), "j")
    altered = written([opened(), taken(1, -0.64), taken(2, 0.4)])[0].replace(b"-0.64", b"-0.65")
    with pytest.raises(InputError, match=r"line 2.* the entry of step 1 does not match"):
        Journal.decode(altered, "j")
    with pytest.raises(InputError, match="line 4"):
        Journal.decode(b"".join([*lines[:3], lines[4], lines[3], *lines[5:]]), "j")


@pytest.mark.parametrize("data", [b"", b"\n", b"hello\n", b"leg,posture\nx,iso\n", b"\0" * 9])
def test_other_files_are_refused(data: bytes) -> None:
    with pytest.raises(InputError):
        Journal.decode(data, "other.txt")


def test_resuming_after_a_cut_goes_on_behind_the_last_whole_record(tmp_path: Path) -> None:
    data, ends = written(eventful()[:4])
    path = tmp_path / "s.journal"
    for cut in (ends[2], ends[2] + 1, ends[3] - 2, ends[3] - 1, ends[3]):
        path.write_bytes(data[:cut])
        with ExitStack() as stack:
            journal = Journal.resume(path, stack)
            kept = list(journal.events)
            assert path.read_bytes() == data[:cut]  # looking at it changes nothing
            journal.append(Noted(at=AT, step=1, text="after"))
            journal.append(Noted(at=AT, step=1, text="again"))
        found = Journal.decode(path.read_bytes(), "j")
        assert list(found.events) == [
            *kept,
            Noted(at=AT, step=1, text="after"),
            Noted(at=AT, step=1, text="again"),
        ]
        assert found.lost == 0


def test_an_existing_file_is_never_replaced(tmp_path: Path) -> None:
    path = tmp_path / "s.journal"
    path.write_text("precious")
    with pytest.raises(UsageError, match="exists"):
        Journal.create(path, opened())
    assert path.read_text() == "precious"


@pytest.mark.parametrize("room", [0, 1, 17, 100])
def test_a_full_disk_loses_nothing_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    path, stack = tmp_path / "s.journal", ExitStack()
    Journal.create(path, opened())
    journal = Journal.resume(path, stack)
    journal.append(taken(1, 0.1))
    before = path.read_bytes()
    real = os.write
    left = room

    def full(descriptor: int, data: memoryview) -> int:
        nonlocal left
        if left == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        part = data[:left]
        left -= len(part)
        return real(descriptor, part)

    monkeypatch.setattr(journal_module.os, "write", full)
    with pytest.raises(InputError, match="No space left on device") as caught:
        journal.append(taken(2, 0.2))
    assert "--resume" in caught.value.remedy
    assert path.read_bytes() == before
    monkeypatch.undo()
    journal.append(taken(2, 0.2))  # space was made: it goes on
    stack.close()
    assert replay(Journal.decode(path.read_bytes(), "j").events).accepted.keys() == {1, 2}


@pytest.mark.parametrize("what", ["removed", "replaced", "longer", "shorter"])
def test_a_journal_that_is_taken_away_stops_the_session(tmp_path: Path, what: str) -> None:
    path = tmp_path / "s.journal"
    Journal.create(path, opened())
    with ExitStack() as stack:
        journal = Journal.resume(path, stack)
        journal.append(taken(1, 0.1))
        whole = path.read_bytes()
        left = {"replaced": b"other", "longer": whole + b"x", "shorter": whole[:-20]}.get(what)
        if what in ("removed", "replaced"):
            path.unlink()
        if left is not None:
            path.write_bytes(left)
        with pytest.raises(InputError, match="could not be saved"):
            journal.append(taken(2, 0.2))
    assert what in ("removed", "longer") or path.read_bytes() == left


seeds = pytest.mark.parametrize("seed", range(8))


@seeds
def test_no_reading_ever_vanishes(seed: int) -> None:
    """Every value that arrived is accepted, replaced or waiting for an answer, exactly once."""
    state = replay([opened()])
    arrived: list[Arrived] = []
    for event in random_events(seed + 100, 80):
        state = advance(state, event)
        arrived += [event] if isinstance(event, Arrived) else []
        held = [item.take for item in state.accepted.values()]
        held += [take for take, _ in state.replaced]
        held += [state.pending] if state.pending else []
        assert sorted(map(id, held)) == sorted(map(id, arrived))
        for step in range(1, 9):
            assert state.takes(step) == sum(take.step == step for take in arrived)


def test_an_undo_takes_back_neither_a_note_nor_the_gauge_in_use() -> None:
    """The session was resumed with another gauge behind the reading that is taken back."""
    records = [opened(), taken(1, 0.1), taken(2, 0.2), Reopened(at=AT, source=("mahr:/dev/x",))]
    state = replay([*records, Noted(at=AT, step=2, text="oil"), Undone(at=AT)])
    assert list(state.accepted) == [1]
    assert (state.source, state.notes) == (("mahr:/dev/x",), ((2, "oil"),))


@seeds
def test_undo_goes_back_one_thing_at_a_time(seed: int) -> None:
    """Before the last reading, retake or skip; what was dropped since comes back with it."""
    state, before = replay([opened()]), []
    for event in random_events(seed, 80):
        kept = isinstance(event, Answered) and event.keep and state.pending
        if kept or isinstance(event, Taken | Retake | Skipped):
            before.append(what_counts(state))
        moved, state = state.moved, advance(state, event)
        if kept and event.moved:
            assert [step for step, _ in state.moved[len(moved) :]] == [kept.step]
        if isinstance(event, Undone) and before:
            assert what_counts(state) == before.pop()


def what_counts(state: State) -> tuple[object, ...]:
    return state.accepted, state.skipped, state.dropped, state.moved
