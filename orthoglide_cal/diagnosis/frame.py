"""The data as a diagnosis sees them: combinations of readings with equal, independent noise.

    d = W y,   W R-whitened so that the noise of d is σ² I

For raw readings W are the zero-free contrasts, for differences the whitened differences. A
cause that relabels readings by T acts on d as the orthogonal matrix W T Wᵀ (W Wᵀ = I).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import CAUSES, Acting, Cause, RelabelCause, Where
from orthoglide_cal.effects import Effect
from orthoglide_cal.estimation import Problem
from orthoglide_cal.estimation.identifiability import require_rank
from orthoglide_cal.estimation.methods import METHODS, pose
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Measured, Readings
from orthoglide_cal.plan import Plan
from orthoglide_cal.protocols import ideal_plan, reduction
from orthoglide_cal.simulation import STEP, doubtful, simulate

# Between a quick session and a slow one: factor on the pace where no times were written down.
UNKNOWN_PACE = 3.0
PER_HOUR = "mm/h"


@dataclass(frozen=True, eq=False)
class Frame:
    """Data and model in whitened form.

    Attributes:
        machine: nominal machine with gauge and tolerances.
        plan: n readings.
        matrix: W, shape (k, n).
        data: d, shape (k,) [mm].
        root: un-whitens, shape (k, k): the identity for raw readings.
        effects: causes accepted earlier.
        timed: True for raw readings, whose order in time is known.
        names: of the differences, in the order of the data; empty for raw readings.
    """

    machine: Machine
    plan: Plan
    matrix: Floats
    data: Floats
    root: Floats
    effects: tuple[Effect, ...]
    timed: bool
    names: tuple[str, ...]

    @classmethod
    def of(cls, measured: Measured, machine: Machine, effects: Sequence[Effect] = ()) -> Frame:
        """Whiten what was measured.

        Raises:
            RankDeficientError: the data do not determine the offsets.
        """
        if isinstance(measured, Readings) and not measured.timed:
            machine = _at_unknown_pace(machine)
        posed = pose(measured, machine, METHODS[measured.kind], effects)
        plan, matrix = posed.problem.plan, posed.problem.matrix
        if isinstance(measured, Readings):
            # Zero-free contrasts are orthonormal.
            white = np.eye(len(matrix))
            frame = cls(machine, plan, matrix, posed.data, white, tuple(effects), True, ())
            require_rank(frame.problem)
            return frame
        require_rank(posed.problem)
        if measured.kind == "six":
            # The readings behind max − min, with the isotropic ones that the carriages pass.
            plan = ideal_plan("twelve", machine)
            matrix = reduction("six", posed.names, machine, plan)
        root = np.asarray(np.linalg.cholesky(matrix @ matrix.T), dtype=np.float64)
        return cls(
            machine,
            plan,
            np.asarray(np.linalg.solve(root, matrix), dtype=np.float64),
            np.asarray(np.linalg.solve(root, posed.data), dtype=np.float64),
            root,
            tuple(effects),
            False,
            posed.names,
        )

    def __len__(self) -> int:
        return len(self.data)

    @property
    def entries(self) -> Floats:
        """What each reading, or each printed difference, adds to the whitened data, (k, m)."""
        return self.matrix if self.timed else np.asarray(np.linalg.inv(self.root))

    def blocks(self) -> list[np.ndarray]:
        """Entries to leave out together: each (leg, direction, posture) cell, or difference."""
        if not self.timed:
            return [np.array([i]) for i in range(len(self))]
        setup, cells = self.plan.setup, self.plan.cells
        blocks = []
        for number in range(cells.max() + 1):
            cell = np.flatnonzero(cells == number)
            # A set-up that leaves with its cell takes its zero along: nothing can predict it.
            others = np.bincount(setup, minlength=self.plan.setups)
            others -= np.bincount(setup[cell], minlength=self.plan.setups)
            kept = cell[others[setup[cell]] > 0]
            if kept.size:
                blocks.append(kept)
        return blocks

    def rms(self, residual: Floats) -> float:
        """Root mean square of a whitened residual over readings, or differences [mm]."""
        plain = self.root @ residual
        return float(np.sqrt((plain @ plain) / self.entries.shape[1]))

    @cached_property
    def problem(self) -> Problem:
        """The whitened problem, for the solver."""
        return Problem(self.machine, self.plan, self.matrix, self.effects)

    def doubt(self, offsets: Floats) -> Floats:
        """What one standard deviation of each accepted parameter adds to the data, (k, p)."""
        return np.asarray(self.matrix @ doubtful(self.machine, offsets, self.plan, self.effects))

    def relabelled(self, cause: RelabelCause, where: Where) -> Floats:
        """The data with a fault of the record undone, shape (k,)."""
        index, sign = cause.relabel(self.plan, where)
        return np.asarray(self.matrix @ (sign * (self.matrix.T @ self.data)[index]))

    def linearised(
        self, offsets: Floats, causes: Sequence[tuple[Cause, Floats]]
    ) -> tuple[Floats, Floats, list[Floats]]:
        """Prediction (k,), its derivatives by the offsets (k, 3) and by each cause's θ (k, p)."""
        acting = [cause.at(theta) for cause, theta in causes]
        readings, slopes = differentiate(self.machine, self.plan, offsets, acting, self.effects)
        ends = np.cumsum([3, *(theta.size for _, theta in causes)])
        by_offsets, *by_causes = np.split(self.matrix @ slopes, ends[:-1], axis=1)
        return self.matrix @ readings, by_offsets, by_causes


def _at_unknown_pace(machine: Machine) -> Machine:
    """Rates of change as plausible as before, on a clock that was only assumed."""
    widened = {
        id: size * UNKNOWN_PACE if id in CAUSES and CAUSES[id].unit == PER_HOUR else size
        for id, size in machine.tolerances.items()
    }
    return replace(machine, tolerances=widened)


def differentiate(
    machine: Machine,
    plan: Plan,
    offsets: Floats,
    acting: Sequence[Acting],
    fixed: Sequence[Effect] = (),
) -> tuple[Floats, Floats]:
    """Readings (n,) and their derivatives by offsets and all parameters of `acting`, (n, q).

    One simulation of many machines: this one, then a complex step in every unknown in turn.
    """
    sizes = [3, *(act.theta.size for act in acting)]
    ends = np.cumsum(sizes)
    step = 1j * STEP * np.eye(ends[-1] + 1, ends[-1], k=-1)
    by_offsets, *by_causes = np.split(step, ends[:-1], axis=1)
    stepped = [
        act.cause.at(act.theta + block, act.where)
        for act, block in zip(acting, by_causes, strict=True)
    ]
    readings = simulate(machine, offsets + by_offsets, plan, (*fixed, *stepped))
    return readings[0].real, readings[1:].imag.T / STEP
