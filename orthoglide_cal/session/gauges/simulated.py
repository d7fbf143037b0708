"""A gauge on a virtual machine whose joint offsets are hidden: for training and for trying."""

from __future__ import annotations

import math

import numpy as np

from orthoglide_cal.model.model import simulate
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.planning.steps import SessionStep
from orthoglide_cal.session.gauges.interface import LiveGauge, Token
from orthoglide_cal.session.readings import Setting
from orthoglide_cal.words import Unit

# Half the width of the ranges that the hidden truth is drawn from.
OFFSETS_MM = 1.5
ZEROS_MM = 0.3
_FINEST_MM = 1e-6  # in which two active offsets are distinguished

_TRUTH, _NOISE = 0, 1  # streams of random numbers


class SimulatedGauge(LiveGauge):
    """Reads what the real gauges would; the same seed gives the same readings.

    The hidden offsets are those of the machine without any correction: what is active in the
    controller acts, so that a correction that was entered is seen when it is measured again.

    Every reading has its own stream of random numbers (seed, step, take, and what is active), so
    that a session that was interrupted reads the same as one that was not. In a session that goes
    on from others, steps count from theirs on, and every part has its own zeros.
    """

    hint = "press Return to read it"
    reads_itself = True

    def __init__(self, setting: Setting, seed: int) -> None:
        self._gauge = setting.machine.gauge
        self._seed = seed
        active = np.array(setting.machine.offsets_mm)
        # Nothing for no correction.
        steps = (active / _FINEST_MM).round().astype(np.int64) % 2**32
        self._active: list[int] = steps.tolist() if steps.any() else []
        rng = np.random.default_rng([seed, _TRUTH])
        self.offsets_mm: Floats = rng.uniform(-OFFSETS_MM, OFFSETS_MM, 3) - active
        plan = setting.plan
        later = (np.random.default_rng([seed, _TRUTH, part]) for part in range(1, plan.parts))
        zeros = np.array([each.uniform(-ZEROS_MM, ZEROS_MM, (3, 3)) for each in (rng, *later)])
        exact = simulate(setting.model, self.offsets_mm, plan)
        zero = zeros[plan.part, plan.leg, plan.direction]
        self._exact: list[float] = (exact + zero).tolist()
        self._before = len(setting.first.readings) if setting.first else 0
        self._wanted = (1, 0)  # step and take

    def begin(self, step: SessionStep, takes: int) -> None:
        """A prompt for this step appears."""
        self._wanted = (step.number, takes)

    def poll(self, asked: bool) -> list[Token]:
        """The reading, once Return was pressed."""
        if not asked:
            return []
        step, takes = self._wanted
        division = self._gauge.resolution_mm
        rng = np.random.default_rng([self._seed, _NOISE, self._before + step, takes, *self._active])
        noisy = self._exact[step - 1] + rng.normal(0.0, self._gauge.repeatability_mm)
        value = round(round(noisy / division) * division, 6)
        decimals = max(0, math.ceil(-math.log10(division)))
        return [Token(f"{value:+.{decimals}f}", value, Unit.MM, source="simulated")]
