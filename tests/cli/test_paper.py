"""`orthocal paper`: each table from the command line."""

import pytest

from orthoglide_cal.paper import tables
from tests.cli.program import answer, done, lines, run


@pytest.mark.parametrize("table", ["1", "4", "5", "accuracy"])
def test_a_table_is_shown_and_reproduced(table: str) -> None:
    shown = done("paper", "--table", table)
    for said in ("published", "computed", "Reproduced in every figure that can be computed."):
        assert said in shown
    assert max(map(len, shown.splitlines())) <= 80
    found = answer("paper", "--table", table)
    assert found["table"] == table
    assert found["reproduced"] is True
    for row in found["rows"]:
        for printed, computed in zip(row["published"], row["computed"] or (), strict=False):
            if printed is not None:
                assert computed == pytest.approx(printed, abs=row["allowed"] + 1e-12)


def test_rows_that_cannot_be_reproduced_say_so() -> None:
    found = answer("paper", "--table", "5")
    twelve = [row for row in found["rows"] if "twelve" in row["name"]]
    assert [(row["computed"], row["reproduced"]) for row in twelve] == [(None, None)] * 3
    assert "twelve-equation rows of Table 5 cannot be recomputed" in found["notes"][0]


def test_a_table_that_is_not_reproduced_is_no_success(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(tables.TABLE_5, "#2 six-equation", (-0.53, 0.59, -1.70, 0.20))
    shown = run("paper", "--table", "5")
    assert shown.exit_code == 4
    assert "NOT reproduced" in shown.stdout


def test_table_3_is_one_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here with 1/50 of the solves; the full table is a slow test."""
    monkeypatch.setattr(tables, "REPLICATIONS", 4)
    monkeypatch.setattr(tables, "RUNS", 1000)
    found = lines(run("paper", "--json"))
    assert [table["table"] for table in found] == ["1", "3", "4", "5", "accuracy"]
    cells = found[1]["rows"]
    assert len(cells) == 4
    for row in cells:
        assert row["computed"][0] == pytest.approx(row["published"][0], rel=0.03)


@pytest.mark.slow
def test_table_3_in_full_from_the_command_line() -> None:
    assert "Reproduced in every figure" in done("paper", "--table", "3")
