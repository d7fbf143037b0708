"""A rail, bar or switch that a technician has loosened and pushed, and what a dial on a leg shows.

The frame is the base's: the other rails stay, and so does the stand, wherever the loose part goes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .delta import DeltaSession, probe_bed, touches
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

    def surface(self, leg: int, direction: int, gauge_at: float, displacement: float) -> float:
        """Position of the bar at the dial, without its zero [mm]."""
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

    def push(self, slot: int, gauge: Gauge, by: float) -> None:
        """Change one number of the condition until the surface at a gauge has moved [mm]."""
        _push(self.pushed, slot, gauge, by)

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


def _push(pushed: Floats, slot: int, gauge: Gauge, by: float) -> None:
    before = gauge()
    pushed[slot] += 0.1
    pushed[slot] += 0.1 * by / (gauge() - before) - 0.1
