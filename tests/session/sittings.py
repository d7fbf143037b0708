"""Sittings answered by a list of lines, for the tests of the loop."""

from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.data import default_machine
from orthoglide_cal.estimation import solve
from orthoglide_cal.session.quit import Quit
from orthoglide_cal.session.record import readings
from orthoglide_cal.session.run import Run

from .virtual import a_run


def typed(values: list[float], step: int = 0) -> list[str]:
    return [f"{value:.2f}" for value in values[step:]]


def offsets(run: Run) -> np.ndarray:
    machine = default_machine()
    return solve(readings(run.state, run.setting.steps, machine, ""), machine).offsets_mm


def until_the_lines_end(path: Path, lines: list[str], **options: object) -> tuple[Run, str]:
    run, screen, journal = a_run(path, lines, **options)  # type: ignore[arg-type]
    with journal, pytest.raises((EOFError, Quit)):
        run.run()
    return run, screen.text
