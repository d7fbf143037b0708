"""Posture programs, written and run by an independent controller.

The controller is a small machine that runs G-code, and knows nothing of what wrote it. It obeys
straight moves (G0, G1) in absolute mm, feeds, dwells, programmed stops and the end; whatever else
stands in the text makes it stop with an error.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
from numpy.typing import NDArray

from orthoglide_cal.cli.plan import write_program
from orthoglide_cal.model.model import Model
from orthoglide_cal.planning.program import posture_program
from orthoglide_cal.planning.steps import MeasuringProtocol, Order, SessionStep, sequence
from tests.cli.program import done
from tests.machines import NOMINAL
from tests.truth.forward import tool_from_carriages

_WORD = re.compile(r"([A-Z][A-Z0-9_]*=|[A-Z])\s*([+-]?(?:\d+\.?\d*|\.\d+))")
# What is left of one that does not end, or has another one in it, is not understood.
_COMMENT = re.compile(r"\(([^()]*)\)|;.*")
# Those that LinuxCNC and others obey.
_OBEYED = re.compile(
    r"\s*(MSG|DEBUG|PRINT|PY|AXIS|LOG|LOGOPEN|LOGAPPEND|LOGCLOSE|PROBEOPEN|PROBECLOSE)\b", re.I
)


@dataclass(frozen=True)
class Move:
    """A straight move of all axes; lengths in mm, feed in mm/min."""

    start: NDArray[np.float64]
    end: NDArray[np.float64]
    feed: float


@dataclass(frozen=True)
class Wait:
    """A stop, until a button is pressed (seconds None) or for a time."""

    block: int | None
    at: NDArray[np.float64]
    arrival: Move
    seconds: float | None


@dataclass
class Controller:
    """State of the machine; begins at `at`, knowing no mode at all."""

    axes: tuple[str, ...]
    at: NDArray[np.float64]
    modes: set[str] = field(default_factory=set)
    feed: float | None = None
    block: int | None = None
    ended: bool = False
    moves: list[Move] = field(default_factory=list)
    waits: list[Wait] = field(default_factory=list)

    @property
    def readings(self) -> list[Wait]:
        """Waits of numbered blocks; at the others gauges are set up."""
        return [wait for wait in self.waits if wait.block is not None]

    @property
    def set_ups(self) -> list[Wait]:
        return [wait for wait in self.waits if wait.block is None]

    def run(self, text: str) -> None:
        """Obey every line; the text must end the program itself."""
        for line in text.splitlines():
            assert len(line) <= 80, line
            for inside in _COMMENT.findall(line):
                assert not _OBEYED.match(inside), f"a comment that some controllers obey: {line}"
            code = _COMMENT.sub("", line).upper().strip()
            if code:
                assert not self.ended, f"after the end: {line}"
                self._line(code)
        assert self.ended

    def _line(self, code: str) -> None:
        words = _WORD.findall(code)
        assert "".join(a + b for a, b in words) == code.replace(" ", ""), f"not understood: {code}"
        places = dict.fromkeys(self.axes, None) | {a: float(b) for a, b in words if a in self.axes}
        codes = {a + b.lstrip("0").rjust(1, "0") for a, b in words if a in "GM"}
        others = {a: float(b) for a, b in words if a not in ("G", "M", *self.axes)}
        known = {"G0", "G1", "G4", "G21", "G90", "G94", "M0", "M1", "M2", "M30"}
        assert codes <= known, codes - known
        assert set(others) <= {"N", "F", "P"}
        if "N" in others:
            self.block = int(others["N"])
        self.modes |= codes
        self.feed = others.get("F", self.feed)
        if any(value is not None for value in places.values()):
            assert codes & {"G0", "G1"}
            self._move(list(places.values()))
        if codes & {"M0", "M1", "G4"}:
            seconds = others["P"] if "G4" in codes else None
            self.waits.append(Wait(self.block, self.at, self.moves[-1], seconds))
            self.block = None
        self.ended = self.ended or bool(codes & {"M2", "M30"})

    def _move(self, wanted: list[float | None]) -> None:
        assert self.modes >= {"G21", "G90"}, "no unit, or not absolute"
        assert self.feed, "no feed"
        end = self.at.copy()
        for axis, value in enumerate(wanted):
            if value is not None:
                end[axis] = value
        self.moves.append(Move(self.at, end, self.feed))
        self.at = end


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
    """The program as it is written to a file, in a folder of its own."""
    chosen = steps_of(model) if steps is None else steps
    own = Path(mkdtemp(dir=folder))
    made, path = own / "made.nc", None
    if template is not None:
        path = own / "template.nc"
        path.write_text(template, encoding="utf-8")
    write_program(posture_program(model, chosen, SESSION, **options), made, path)  # type: ignore[arg-type]
    return made.read_text(encoding="utf-8")


def default_template() -> str:
    return done("template", "gcode")


def true_tool(length: float, joints: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the tool is, shape (3, n), for joints of shape (n, 3)."""
    carriages = np.zeros((3, 3, len(joints)))
    carriages[range(3), range(3)] = joints.T
    legs = np.full((3, 1), length)
    return tool_from_carriages(carriages, legs, joints.T - length)


def visits_of(steps: Sequence[SessionStep]) -> list[SessionStep]:
    """The first step of each visit."""
    return [steps[0], *(b for a, b in pairwise(steps) if a.visit != b.visit)]
