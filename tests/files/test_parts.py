"""Readings of several parts in files: read, refused where they are wrong, written as they were."""

from pathlib import Path

import pytest

from orthoglide_cal.files import (
    check_file,
    read_input,
    readings_csv,
    session_of_readings,
    session_text,
)
from orthoglide_cal.model import Model, Readings
from tests.machines import PROTOTYPE

from .helpers import problems

HEADER = "leg,posture,direction,reading_mm,part,bar,entered,gauge_at\n"
ROWS = [
    "x,iso,y,0.10,,,,",
    "x,max,y,0.09,,,,",
    "x,min,y,0.19,1,,0.5 0 -0.25,",
    "x,iso,y,0.11,2,turned,,0.25",
    "x,max,y,0.12,2,Turned,0.5 0 -0.25,0.25",
]


def read(path: Path, rows: list[str] = ROWS) -> Readings:
    path.write_text(HEADER + "\n".join(rows) + "\n")
    found = read_input(str(path), Model(PROTOTYPE)).measured
    assert isinstance(found, Readings)
    return found


def test_the_columns_are_read(tmp_path: Path) -> None:
    plan = read(tmp_path / "r.csv").plan
    assert plan.part.tolist() == [0, 0, 0, 1, 1]
    assert plan.turned.tolist() == [False, False, False, True, True]
    assert plan.entered.tolist() == [[0, 0, 0]] * 2 + [[0.5, 0, -0.25], [0, 0, 0], [0.5, 0, -0.25]]
    assert plan.setup.tolist() == [0, 0, 0, 1, 1]


def test_a_new_part_has_new_zeros_whatever_its_gauges_are_called(tmp_path: Path) -> None:
    rows = [f"{row},A" for row in ("x,iso,y,0.1,1", "x,max,y,0.2,1", "x,iso,y,0.3,2")]
    path = tmp_path / "r.csv"
    path.write_text("leg,posture,direction,reading_mm,part,gauge\n" + "\n".join(rows))
    measured = read_input(str(path), Model(PROTOTYPE)).measured
    assert measured.plan.setup.tolist() == [0, 0, 1]
    assert measured.cycle.tolist() == [1, 1, 1]


def test_decimal_commas_are_read_in_it(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text("leg;posture;direction;reading_mm;entered\nx;iso;y;0,1;0,5 0 -0,25\n")
    measured = read_input(str(path), Model(PROTOTYPE)).measured
    assert measured.plan.entered.tolist() == [[0.5, 0.0, -0.25]]


@pytest.mark.parametrize(
    ("row", "text", "column", "said"),
    [
        (1, "x,max,y,0.09,0,,,", "part", "whole number from 1"),
        (1, "x,max,y,0.09,b,,,", "part", "whole number from 1"),
        (4, "x,max,y,0.12,1,turned,,0.25", "part", "Part 1 does not follow part 2."),
        (4, "x,max,y,0.12,4,turned,,0.25", "part", "Part 4 does not follow part 2."),
        (3, "x,iso,y,0.11,2,yes,,0.25", "bar", "does not say how the bar was"),
        (2, "x,min,y,0.19,1,,0.5 0,", "entered", "Three numbers are needed"),
        (2, "x,min,y,0.19,1,,0.5 0 one,", "entered", "not a number"),
        (2, "x,min,y,0.19,1,,0 0 500,", "entered", "larger than the leg"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, row: int, text: str, column: str, said: str) -> None:
    (fault,) = problems(read, tmp_path / "r.csv", [*ROWS[:row], text, *ROWS[row + 1 :]])
    assert (fault.line, fault.column) == (row + 2, column)
    assert said in fault.what


def test_a_bar_that_is_turned_within_a_part_gets_new_zeros(tmp_path: Path) -> None:
    """Even where gauges are labelled: nobody turns a bar under a plunger."""
    rows = [
        f"x,{posture},{axis},0.1,1,{bar},,"
        for bar in ("", "turned")
        for posture in ("iso", "max")
        for axis in "yz"
    ]
    plan = read(tmp_path / "r.csv", rows).plan
    assert plan.setup.tolist() == [0, 1, 0, 1, 2, 3, 2, 3]


def test_a_usual_file_has_no_such_column(tmp_path: Path) -> None:
    usual = read(tmp_path / "r.csv", ["x,iso,y,0.10,1,,0 0 0,0.5"])
    assert not {"part", "bar", "entered", "gauge_at"} & set(
        readings_csv(usual).splitlines()[0].split(",")
    )


def test_readings_that_were_replaced_are_checked_for_it_too(tmp_path: Path) -> None:
    session = session_of_readings(read(tmp_path / "r.csv"), Model(PROTOTYPE), {})
    retaken = session.readings[4].model_copy(update={"reason": "slipped"})
    path = tmp_path / "s.yaml"
    path.write_text(session_text(session.model_copy(update={"retaken": (retaken,)})))
    assert check_file(str(path))[0].valid
    assert "bar: turned" in path.read_text().split("retaken:")[1]
    path.write_text(path.read_text().replace(", reason:", " 0, reason:"))
    (problem,) = check_file(str(path))[0].problems
    assert "Three numbers are needed" in problem.what
