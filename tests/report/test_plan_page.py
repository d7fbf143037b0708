"""The words and numbers of a plan's page."""

import re

import numpy as np
import pytest

from orthoglide_cal.estimation.budget import Budget, Contribution, budget_lines
from orthoglide_cal.model import Model
from orthoglide_cal.model.machine import Origin
from orthoglide_cal.planning.plan import Wanted, measurement_plan
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.documents.plan import plan_document
from orthoglide_cal.report.documents.solution import budget_sections
from orthoglide_cal.report.figures import separation_lines
from tests.machines import NOMINAL, both_models


def grid_of(section: doc.Section) -> doc.Grid:
    return next(block for block in section.blocks if isinstance(block, doc.Grid))


@both_models
@pytest.mark.parametrize("cycles", [1, 3, 10])
def test_a_way_that_takes_longer_is_shown_as_less_sure(model: Model, cycles: int) -> None:
    sections = plan_document(measurement_plan(model, Wanted(cycles=cycles))).page().sections
    grid = grid_of(next(s for s in sections if s.title == "Other ways to the same uncertainty"))
    assert grid.caption
    (wanted,) = re.findall(r"± ([\d.]+) mm", grid.caption)
    longer = 0
    for _, _, reach, needed, readings, *_ in grid.rows:
        takes_longer = readings == "never" or int(str(needed)) > cycles
        longer += takes_longer
        assert (float(str(reach)) > float(wanted)) == takes_longer
    assert longer >= 4


@pytest.mark.parametrize(("count", "said"), [(1, "1 other"), (2, "2 others")])
def test_small_sources_are_counted(count: int, said: str) -> None:
    def source(name: str, size: float) -> Contribution:
        return Contribution(name, "B", size, "mm", False, size**2 * np.eye(3))

    small = (Origin.RESOLUTION, Origin.GAUGE_SCALE)[:count]
    budget = Budget((source(Origin.NOISE, 1.0), *(source(name, 0.01) for name in small)))
    (section,) = budget_sections(NOMINAL.machine, *budget_lines(budget))
    rows = grid_of(section).rows
    assert [row[0] for row in rows if "other" in str(row[0])] == [said]


def test_the_legend_of_separations_names_all_that_is_shown() -> None:
    sigma = np.array([[0.0, 0.3, 1.5], [0.3, 0.0, 3.9], [1.5, 3.9, 0.0]])
    names, trace = ["a", "b", "c"], np.array([120.0, 5.0, 5.0])
    *table, legend, rest = separation_lines(names, sigma, trace)
    assert " 99 " in f"{table[1]} "
    assert "99: or more" in rest
    # Each shade with what it says of telling apart; the indentation of a block leaves 78.
    assert legend.startswith("Distinct? ")
    assert [legend.partition(shade)[2].split(":")[1].split(";")[0] for shade in "█▓▒"] == [
        " no", " hardly", " mostly",
    ]  # fmt: skip
    assert len(legend) <= 78
