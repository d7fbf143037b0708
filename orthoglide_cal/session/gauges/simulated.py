"""A gauge on a virtual machine whose joint offsets are hidden: for training and for trying."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.effects import Effect
from orthoglide_cal.machine import Machine
from orthoglide_cal.session.gauges.source import Heard
from orthoglide_cal.session.gauges.token import Token
from orthoglide_cal.session.steps import Step, plan_of
from orthoglide_cal.simulation import simulate

# Half the width of the ranges that the hidden truth is drawn from.
OFFSETS_MM = 1.5
ZEROS_MM = 0.3

_TRUTH, _NOISE = 0, 1  # streams of random numbers


class SimulatedGauge:
    """Reads what the real gauges would; the same seed gives the same readings.

    Every reading has its own stream of random numbers (seed, step, take), so that a session
    that was interrupted reads the same as one that was not.
    """

    hint = "press Return to read it"

    def __init__(
        self, machine: Machine, steps: Sequence[Step], seed: int, effects: Sequence[Effect] = ()
    ) -> None:
        self._machine = machine
        self._seed = seed
        rng = np.random.default_rng([seed, _TRUTH])
        self.offsets_mm: Floats = rng.uniform(-OFFSETS_MM, OFFSETS_MM, 3)
        zeros = rng.uniform(-ZEROS_MM, ZEROS_MM, (3, 3))
        plan = plan_of(steps)
        exact = simulate(machine, self.offsets_mm, plan, effects)
        self._exact = exact + zeros[plan.leg, plan.direction]
        self._step = steps[0]
        self._takes = 0
        self._asked = False

    def begin(self, step: Step, takes: int) -> None:
        """A prompt for this step appears."""
        self._step, self._takes, self._asked = step, takes, False

    def request(self) -> None:
        """Return was pressed: the gauge is read."""
        self._asked = True

    def poll(self) -> list[Heard]:
        """The reading, once it was asked for."""
        if not self._asked:
            return []
        self._asked = False
        gauge = self._machine.gauge
        rng = np.random.default_rng([self._seed, _NOISE, self._step.number, self._takes])
        noisy = self._exact[self._step.number - 1] + rng.normal(0.0, gauge.repeatability_mm)
        value = round(round(float(noisy) / gauge.resolution_mm) * gauge.resolution_mm, 6)
        decimals = max(0, math.ceil(-math.log10(gauge.resolution_mm)))
        return [Heard(Token(value, "mm", "", f"{value:+.{decimals}f}"), "simulated")]

    def reconnect(self) -> bool:
        """It is never lost."""
        return True

    def close(self) -> None:
        """Nothing to let go of."""
