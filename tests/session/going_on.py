"""Sessions that go on from others: what is chosen, and what is then in the files."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from orthoglide_cal.files.input import read_input
from orthoglide_cal.inference.diagnose import diagnose
from orthoglide_cal.inference.result import NextMeasurement
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.planning.next_measurement import rank_measurements
from orthoglide_cal.session.events import Event, Journal

SIMULATED = ("--gauge", "simulated", "--seed", "7", "--yes")


def read(path: Path) -> Readings:
    return read_input(str(path)).measured


@functools.cache
def _options(path: Path, content: bytes) -> tuple[NextMeasurement, ...]:
    """Recommended after a file with this content, best first; ranked once."""
    given = read_input(str(path))
    return rank_measurements(diagnose(given.measured, given.model))


def choice(path: Path, wanted: Callable[[NextMeasurement], object]) -> tuple[str, ...]:
    """The options of the command that carry out the first recommendation that is wanted."""
    options = _options(path, path.read_bytes())
    number = next(k for k, option in enumerate(options, start=1) if wanted(option))
    return ("--then", str(path), "--choice", str(number), "--yes")


def is_step(option: NextMeasurement) -> bool:
    return option.continues and bool(option.plan.entered[:, 0].any())


def is_turn(option: NextMeasurement) -> bool:
    anew = not option.continues and set(option.plan.leg) == {1}
    return anew and bool(option.plan.turned.all())


def is_usual(option: NextMeasurement) -> bool:
    return not (option.continues or option.plan.turned.any()) and set(option.plan.leg) == {1}


def content(path: Path) -> dict[str, Any]:
    values: dict[str, Any] = yaml.safe_load(path.read_text())
    return values


def events_of(path: Path) -> tuple[Event, ...]:
    return Journal.decode(path.read_bytes(), "j").events
