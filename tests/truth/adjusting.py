"""A rail, bar, switch or tower that a technician has loosened and pushed, and what is read then.

The frame is the base's: the other rails stay, and so does the stand, wherever the loose part goes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .delta import DeltaSession, Truth, touches
from .effects import state_with
from .forward import PAIRS, PARTS, _rails, tool_from_carriages
from .plan import SETUPS, Floats, joints_at, standard_plan
from .session import Session, measure

Gauge = Callable[[], float]


@dataclass(eq=False)
class LooseMachine:
    """The machine of a session; `pushed` are changes of its condition by a screw, shape (30,)."""

    session: Session
    rng: np.random.Generator

    def __post_init__(self) -> None:
        session = self.session
        self.state = state_with(session.offsets, session.effects)
        self.state[PARTS["leg_length"]] += session.setting.legs
        self.pushed = np.zeros_like(self.state)
        self.zero = float(self.rng.uniform(-2.0, 2.0))
        self.misplaced = float(self.rng.normal())

    def left(self, cause: str, number: int) -> tuple[int, float]:
        """Index of a parameter of a cause among `pushed`, and what is left of it."""
        slot = PARTS["offsets" if cause == "home_switch" else cause].start + number
        return slot, float(self.state[slot] + self.pushed[slot])

    def _points(self, leg: int, displacement: float, pushed: Floats) -> tuple[Floats, Floats]:
        """Carriage joints (3, 3) and tool (3,) [mm] at a posture."""
        length = self.session.machine.leg
        points, ways = (part[..., 0] for part in _rails(self.state[None]))
        for (first, second), gap, angle in zip(
            PAIRS, pushed[PARTS["axis_gap"]], pushed[PARTS["axis_squareness"]], strict=True
        ):
            points[second, 3 - first - second] -= gap
            ways[second, first] += 1e-3 * angle
        joints = joints_at(length, leg, displacement) + (self.state + pushed)[PARTS["offsets"]]
        carriages = points + ways * joints[:, None]
        near = displacement * np.eye(3)[leg]
        legs = length + self.state[PARTS["leg_length"]]
        return carriages, tool_from_carriages(carriages[..., None], legs[:, None], near[:, None])[
            :, 0
        ]

    def surface(self, cell: Any) -> float:
        """Position of the bar at the dial, without its zero [mm]; a cell says where it stands."""
        leg, direction, gauge_at = cell.leg, cell.direction, cell.gauge_at
        displacement = cell.displacement
        carriages, tool = self._points(leg, 0.0, np.zeros_like(self.pushed))
        stand = carriages[leg, leg] + gauge_at * (tool[leg] - carriages[leg, leg])
        stand -= self.misplaced  # the tool lies below the carriage on the leg's axis
        carriages, tool = self._points(leg, displacement, self.pushed)
        span = tool[leg] - carriages[leg, leg]
        share = (stand - carriages[leg, leg]) / span
        slopes = (self.state + self.pushed)[PARTS["bar_skew"]]
        slope = 1e-3 * slopes[SETUPS.index((leg, direction))] * self.session.machine.leg
        foot = carriages[leg, direction]
        return float(foot + share * (tool[direction] - foot) + slope * share)

    def measured_again(self) -> Session:
        """The machine as it was pushed, another day.

        Both rails of a pair share their gap, so one that is pushed alone takes the frame half the
        way along the third axis: there the third carriage stands back by as much.
        """
        session, offsets = self.session, self.session.offsets + self.pushed[PARTS["offsets"]]
        for (first, second), gap in zip(PAIRS, self.pushed[PARTS["axis_gap"]], strict=True):
            offsets[3 - first - second] += gap / 2.0
        effects = tuple(
            replace(e, parameters=tuple((e.parameters + self.pushed[PARTS[e.id]]).tolist()))
            for e in session.effects
        )
        plan, setting = standard_plan(session.machine, self.rng), session.setting
        parts = session.machine, session.gauge, plan, offsets, effects, self.rng
        return measure(*parts, setting=setting)

    def dial(self, surface: float) -> float:
        """What the dial shows [mm]."""
        gauge, scale = self.session.gauge, self.session.setting.scale
        noisy = (1.0 + scale) * surface + self.zero + self.rng.normal(scale=gauge.noise)
        return float(np.round(noisy / gauge.resolution) * gauge.resolution)


@dataclass(eq=False)
class LoosePrinter:
    """The printer of a session; `pushed` are leans that were added to its towers [mrad], (6,).

    First away from the middle, then sideways. A tower turns somewhere below the bed, in the corner
    that holds its foot.
    """

    session: DeltaSession
    rng: np.random.Generator

    def __post_init__(self) -> None:
        self.pushed = np.zeros(6)
        self.below = float(self.rng.uniform(0.0, 60.0))

    def left(self, cause: str, number: int) -> tuple[int, float]:
        """Index of a parameter of a cause among `pushed`, and what is left of it."""
        return number, float(self.session.truth.leans.T.ravel()[number] + self.pushed[number])

    @property
    def truth(self) -> Truth:
        """The printer as it stands now."""
        truth, (out, side) = self.session.truth, self.pushed.reshape(2, 3)
        moved = 1e-3 * self.below * np.stack((out, side))  # of each rail where it meets the bed
        angles = truth.angles + np.degrees(moved[1] / self.session.machine.radius)
        leans = truth.leans + np.stack((out, side), axis=1)
        return replace(truth, leans=leans, radii=truth.radii + moved[0], angles=angles)

    def surface(self, cell: Any) -> float:
        """Height at which the probe triggers, without its noise [mm]."""
        x, y, nothing = np.array([cell.x_mm]), np.array([cell.y_mm]), np.zeros(1)
        return float(touches(self.session.machine, self.truth, x, y, nothing, nothing)[0])

    def dial(self, surface: float) -> float:
        """What the probe says [mm]."""
        return float(np.round(surface + self.rng.normal(scale=self.session.machine.noise), 4))


def push(loose: LooseMachine | LoosePrinter, slot: int, gauge: Gauge, by: float) -> None:
    """Change one number of the condition until the surface at a gauge has moved [mm]."""
    before = gauge()
    loose.pushed[slot] += 0.1
    loose.pushed[slot] += 0.1 * by / (gauge() - before) - 0.1
