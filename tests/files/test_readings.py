"""Readings: what is accepted, every fault with its place, what shows across rows, set-ups; written
as CSV they come back exactly."""

import dataclasses
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthoglide_cal.files.input import check_file, read_input
from orthoglide_cal.files.readings import readings_csv, session_of_readings, session_text
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.model.readings import Contact
from tests.readings import readings_of, some
from tests.sentences import sentences

from .helpers import MACHINE, VARIANTS, document, measured, places, problems, readings, replaced

HEAD = "leg,posture,direction,reading_mm"
GOOD = f"{HEAD}\nx,iso,y,0.12\nx,max,y,-0.25\nz,-20.5,x,1\n"


def test_the_required_columns_are_enough(tmp_path):
    read = readings(tmp_path, GOOD)
    assert read.value.tolist() == [0.12, -0.25, 1.0]
    assert read.plan.leg.tolist() == [0, 0, 2]
    assert read.plan.direction.tolist() == [1, 1, 0]
    assert read.plan.displacement.tolist() == [0.0, 60.0, -20.5]
    assert read.posture == ("iso", "max", "-20.5")
    assert read.plan.gauge_at.tolist() == [0.5] * 3
    assert read.plan.contact.tolist() == [Contact.FIXED] * 3
    assert read.plan.setup.tolist() == [0, 0, 1]
    assert read.plan.order.tolist() == [0, 1, 2]
    assert read.cycle.tolist() == [1, 1, 1]
    assert read.line.tolist() == [2, 3, 4]
    assert np.isnan(read.temperature).all()
    assert not read.timed
    np.testing.assert_allclose(read.plan.hours * 60, [0.0, 0.4, 0.8])
    assert sentences(read.remarks) == [
        "Times were not given, or are all the same; 0.4 minutes per reading were assumed."
    ]


@pytest.mark.parametrize("other", VARIANTS["readings"])
def test_other_ways_to_write_the_same(tmp_path, other):
    same, read = readings(tmp_path, GOOD), readings(tmp_path, replaced(GOOD, other))
    assert read.value.tolist() == same.value.tolist()
    for name in ("leg", "direction", "displacement", "setup", "order", "hours"):
        assert getattr(read.plan, name).tolist() == getattr(same.plan, name).tolist()
    assert read.posture == same.posture
    assert read.remarks == same.remarks


@pytest.mark.parametrize(
    ("unit", "cell", "mm"), [("in", "-0,01", -0.254), ("mm", "1,234", 1.234)], ids=["inch", "comma"]
)
def test_inches_and_no_thousands(tmp_path, unit, cell, mm):
    read = readings(tmp_path, f"leg;posture;direction;reading_{unit}\nx;iso;y;{cell}\n")
    assert read.value.tolist() == [mm]


def test_one_row_may_be_in_mm_and_another_in_inches(tmp_path):
    read = readings(tmp_path, f"{HEAD},reading_in\nx,iso,y,0.1,\nx,max,y,,-0.01\n")
    assert read.value.tolist() == [0.1, -0.254]


def test_everything_is_collected_in_the_order_of_lines(tmp_path):
    text = f"{HEAD},seq\nq,iso,w,x,1\nx,iso,y,0.1,1\nx,99,x,,1\n"
    assert places(problems(measured, tmp_path, text)) == [
        (2, "leg", "q"), (2, "direction", "w"), (2, "reading_mm", "x"),
        (4, "posture", "99"), (4, "direction", "x"), (4, "reading_mm", None),
    ]  # fmt: skip


def test_a_file_without_a_header(tmp_path):
    found = problems(measured, tmp_path, "x,iso,y,0.1\n")
    assert {fault.column for fault in found} == {"leg", "posture", "direction", "reading_mm"}
    assert "the header has: x, iso, y, 0.1" in found[0].remedy


def test_what_is_no_table_does_not_fill_the_screen(tmp_path):
    for text in (f"<svg {'q' * 5000},<rect>\n", f"{HEAD}\nx,iso,{'q' * 5000},1\n"):
        (fault, *_) = problems(measured, tmp_path, text)
        assert "qqq…" in str(fault)
        assert len(str(fault)) < 300


def test_the_line_is_where_a_row_begins(tmp_path):
    text = f'{HEAD},note\nx,iso,y,0.1,"two\nlines"\n\nx,max,y,bad,\n'
    assert [fault.line for fault in problems(measured, tmp_path, text)] == [5]
    assert readings(tmp_path, text.replace("bad", "1")).line.tolist() == [2, 5]


def test_a_note_that_starts_with_a_hash_is_a_reading(tmp_path):
    read = readings(tmp_path, f"note,{HEAD}\n#3 again,x,iso,y,0.1\n,x,max,y,0.2\n")
    assert read.note == ("#3 again", "")


REMARKS = [
    (f"{HEAD},minutes,Comment\nx,iso,y,0,0,hi\n", "not used: comment"),
    (f"{HEAD},minutes,nots\nx,iso,y,0,0,hi\n", "Did you mean 'note'?"),
    (f"{HEAD},minutes\nx,iso,y,12.5,0\n", "beyond the gauge's range of 10 mm (first: line 2"),
    (f"{HEAD},minutes\nx,iso,y,1,0\nx,max,y,1,0\n", "are all the same"),
]


@pytest.mark.parametrize(("text", "words"), REMARKS)
def test_remarks(tmp_path, text, words):
    assert [words in remark for remark in sentences(readings(tmp_path, text).remarks)] == [True]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (HEAD + "\n" + "x,iso,y,0.1\n" * 25_001, "more than 25000 rows"),
        (HEAD + "\n" + "q,iso,y,0.1\n" * 20_000, "more faults like these"),
        (HEAD + "\nx,iso,y," + "1" * 1_000_000, "field larger"),
        (HEAD + '\nx,iso,y,"' + "\n" * 1_000_000, "field larger"),
        ("," * 1_000_000 + "\n1\n", "more than 100 columns"),
        (",".join(f"c{i}" for i in range(300_000)) + "\n1\n", "more than 100 columns"),
    ],
)
def test_hostile_tables_are_refused(tmp_path, monkeypatch, text, what):
    monkeypatch.setattr("orthoglide_cal.files.readings._ROWS", 25_000)  # a quarter of what it takes
    start = time.process_time()
    found = problems(measured, tmp_path, text)
    assert time.process_time() - start < 2.5
    assert max(len(str(fault)) for fault in found) < 1000
    assert len(found) <= 1001
    assert any(what in fault.what for fault in found)


LABELLED = "leg,posture,direction,gauge,reading_mm"
ROWS = ["x,iso,y,A,0.1", "x,max,y,A,0.2", "y,iso,z,A,0.3", "x,iso,y,A,0.4"]


def test_only_a_stated_order_tells_of_a_return(tmp_path):
    read = readings(tmp_path, "\n".join([LABELLED, *ROWS]))
    assert read.plan.setup.tolist() == [0, 0, 1, 0]
    assert read.cycle.tolist() == [1, 1, 1, 2]
    for column in ("seq", "minutes"):
        stated = [f"{LABELLED},{column}", *(f"{row},{k}" for k, row in enumerate(ROWS))]
        read = readings(tmp_path, "\n".join(stated))
        assert read.plan.setup.tolist() == [0, 0, 1, 2]
    # Whatever the order of the rows.
    stated = [f"{LABELLED},seq", *(f"{row},{k}" for row, k in zip(ROWS, (0, 1, 3, 2), strict=True))]
    assert readings(tmp_path, "\n".join(stated)).plan.setup.tolist() == [0, 0, 1, 0]


def made(plan, **changes) -> Readings:
    n = len(plan)
    value = np.random.default_rng(7).normal(0.0, 1.0, n)
    readings = readings_of(MACHINE, plan, value)
    return dataclasses.replace(readings, cycle=1 + np.arange(n) // 6, **changes)


NOTES = st.text("ab #,;:'\"é-\n\t", max_size=12).map(str.strip)


@given(data=st.data())
@settings(max_examples=40, derandomize=True, deadline=None)
def test_what_is_written_is_read_back_exactly(data):
    """As a table and as a session: of all protocols, in any order of rows, with every column.

    Set-ups that only the plan distinguishes get labels of their own.
    """
    draw = data.draw
    cycles, at = draw(st.integers(1, 2)), draw(st.sampled_from((0.5, 0.3)))
    single = draw(st.booleans())
    plan = (
        single_posture(MACHINE, cycles) if single else double_posture(MACHINE, cycles, gauge_at=at)
    )
    n, cut = len(plan), draw(st.integers(1, len(plan)))
    late = plan.order >= cut
    if draw(st.booleans()):
        in_parts = (plan.setup, late, late & (plan.leg == 0))
        plan = dataclasses.replace(
            plan,
            part=late.astype(int),
            turned=late & (plan.leg == 0),
            entered=np.outer(late, (0.5, 0.0, -1 / 3)),
            setup=np.unique(np.stack(in_parts), axis=1, return_inverse=True)[1].reshape(-1),
        )
    elif draw(st.booleans()):
        moved = plan.setup + plan.setups * late
        plan = dataclasses.replace(plan, setup=np.unique(moved, return_inverse=True)[1])
    warm = draw(st.sampled_from((np.nan, 20 + 1 / 7)))
    readings = made(
        plan,
        temperature=np.where(np.arange(n) % 2, np.nan, warm),
        gauge=tuple(draw(st.sampled_from((("",), ("A", "B"))))[k % 2 - 1] for k in range(n)),
        note=tuple(draw(st.lists(NOTES, min_size=n, max_size=n))),
        timed=draw(st.booleans()),
    )
    if draw(st.booleans()):
        readings = some(readings, np.random.default_rng(draw(st.integers(0, 99))).permutation(n))
    session = session_text(session_of_readings(readings, Model(MACHINE), {}))
    for name, text in (("r.csv", readings_csv(readings)), ("s.yaml", session)):
        read = read_input(document(text, name), Model(MACHINE)).measured
        same = readings if name == "r.csv" else some(readings, readings.plan.in_time)
        for field in ("value", "cycle", "temperature"):
            np.testing.assert_array_equal(getattr(read, field), getattr(same, field), field)
        for field in ("posture", "note", "timed"):
            assert getattr(read, field) == getattr(same, field)
        for field in ("leg", "direction", "displacement", "contact", "part", "turned", "entered"):
            mine, theirs = getattr(read.plan, field), getattr(same.plan, field)
            np.testing.assert_array_equal(mine, theirs, field)
        fixed = same.plan.contact == 0
        np.testing.assert_array_equal(read.plan.gauge_at[fixed], same.plan.gauge_at[fixed])
        np.testing.assert_array_equal(read.plan.order, same.plan.order)
        if same.timed:
            np.testing.assert_allclose(read.plan.hours, same.plan.hours, rtol=0, atol=1e-8)
        pairs = {*zip(read.plan.setup.tolist(), same.plan.setup.tolist(), strict=True)}
        assert len(pairs) == read.plan.setups == same.plan.setups


def test_columns_without_content_are_left_out_and_minutes_are_short():
    header, *rows = readings_csv(made(double_posture(MACHINE, cycles=1))).splitlines()
    assert header == "leg,posture,direction,cycle,reading_mm,seq,minutes"
    minutes = "0 0.4 0.8 1.2 5.6 6 6.4 6.8 11.2 11.6 12 12.4"
    assert [row.split(",")[6] for row in rows[::2]] == minutes.split()
    assert "gauge_at" not in readings_csv(made(single_posture(MACHINE, cycles=1)))


# --- several parts ----------------------------------------------------------------------------

WITH_PARTS = f"{HEAD},part,bar,entered,gauge_at"
PARTED = [
    "x,iso,y,0.10,,,,",
    "x,max,y,0.09,,,,",
    "x,min,y,0.19,1,,0.5 0 -0.25,",
    "x,iso,y,0.11,2,turned,,0.25",
    "x,max,y,0.12,2,Turned,0.5 0 -0.25,0.25",
]


def parted(folder, rows=PARTED):
    return readings(folder, "\n".join([WITH_PARTS, *rows, ""]))


def test_decimal_commas_are_read_in_what_was_entered(tmp_path):
    text = "leg;posture;direction;reading_mm;entered\nx;iso;y;0,1;0,5 0 -0,25\n"
    assert readings(tmp_path, text).plan.entered.tolist() == [[0.5, 0.0, -0.25]]


def test_a_bar_that_is_turned_within_a_part_gets_new_zeros(tmp_path):
    """Even where gauges are labelled: nobody turns a bar under a plunger."""
    rows = [
        f"x,{posture},{axis},0.1,1,{bar},,"
        for bar in ("", "turned")
        for posture in ("iso", "max")
        for axis in "yz"
    ]
    plan = parted(tmp_path, rows).plan
    assert plan.setup.tolist() == [0, 1, 0, 1, 2, 3, 2, 3]


def test_readings_that_were_replaced_are_checked_for_it_too(tmp_path):
    session = session_of_readings(parted(tmp_path), Model(MACHINE), {})
    retaken = session.readings[4].model_copy(update={"reason": "slipped"})
    path = tmp_path / "s.yaml"
    path.write_text(session_text(session.model_copy(update={"retaken": (retaken,)})))
    assert check_file(str(path))[0].valid
    assert "bar: turned" in path.read_text().split("retaken:")[1]
    path.write_text(path.read_text().replace(", reason:", " 0, reason:"))
    (problem,) = check_file(str(path))[0].problems
    assert "Three numbers are needed" in problem.what


def test_one_simulated_row_marks_all_that_is_made_of_the_file(tmp_path):
    read = readings(tmp_path, f"{HEAD},simulated\nx,iso,y,1,\nx,max,y,2,Yes\n")
    assert read.source.simulated
    assert readings_csv(read).count("yes") == 2
