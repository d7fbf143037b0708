"""Posture programs, written and run by an independent controller."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from orthoglide_cal.cli.plan import write_program
from orthoglide_cal.model.model import Model
from orthoglide_cal.planning.program import posture_program
from orthoglide_cal.planning.steps import MeasuringProtocol, Order, SessionStep, sequence
from tests.cli.program import run
from tests.machines import NOMINAL
from tests.planning.gcode import Controller
from tests.truth.forward import tool_from_carriages

SESSION = "orthocal measure --cycles 2"


def steps_of(
    model: Model,
    protocol: MeasuringProtocol = MeasuringProtocol.DOUBLE,
    order: Order = Order.PAPER,
    stands: int = 2,
) -> tuple[SessionStep, ...]:
    return sequence(model.machine, protocol, 2, order, stands)


def ran(text: str, home: float, axes: tuple[str, ...] = ("X", "Y", "Z")) -> Controller:
    """What a controller did, the axes being the carriages."""
    controller = Controller(axes, np.full(3, float(home)))
    controller.run(text)
    return controller


def gcode(
    folder: Path,
    model: Model = NOMINAL,
    steps: Sequence[SessionStep] | None = None,
    template: str | None = None,
    **options: object,
) -> str:
    """The program as it is written to a file."""
    chosen = steps_of(model) if steps is None else steps
    made, path = folder / "made.nc", None
    if template is not None:
        path = folder / "template.nc"
        path.write_text(template, encoding="utf-8")
    write_program(posture_program(model, chosen, SESSION, **options), made, path)  # type: ignore[arg-type]
    return made.read_text(encoding="utf-8")


def default_template() -> str:
    shown = run("template", "gcode")
    assert shown.exit_code == 0
    return shown.stdout


def true_tool(length: float, joints: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the tool is, shape (3, n), for joints of shape (n, 3)."""
    carriages = np.zeros((3, 3, len(joints)))
    carriages[range(3), range(3)] = joints.T
    legs = np.full((3, 1), length)
    return tool_from_carriages(carriages, legs, joints.T - length)


def visits_of(steps: Sequence[SessionStep]) -> list[SessionStep]:
    """The first step of each visit."""
    return [steps[0], *(b for a, b in pairwise(steps) if a.visit != b.visit)]
