"""Causes that write readings down under another sign or label undo themselves."""

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES, RelabelCause
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.effects import Commanded
from orthoglide_cal.protocols import double_posture
from orthoglide_cal.simulation import simulate
from tests.machines import PROTOTYPE
from tests.report.sessions import readings_of

RELABELS = [cause for cause in CAUSES.values() if isinstance(cause, RelabelCause)]
every_relabel = pytest.mark.parametrize("cause", RELABELS, ids=[c.id for c in RELABELS])


@every_relabel
def test_twice_is_not_at_all(cause: RelabelCause) -> None:
    plan = double_posture(PROTOTYPE)
    commanded = Commanded(PROTOTYPE, plan)
    values = np.random.default_rng(4).uniform(-2.0, 2.0, len(plan))
    for where in cause.places(plan, PROTOTYPE):
        acting = cause.at(np.zeros(0), where)
        once = acting.record(values, commanded)
        assert np.abs(once - values).max() > 0.1
        assert acting.record(once, commanded) == pytest.approx(values, abs=0.0)


@every_relabel
def test_undoing_it_in_the_data_is_undoing_it_in_the_readings(cause: RelabelCause) -> None:
    """On the whitened data it acts as W T Wᵀ: zeros of any size have no part in it."""
    plan = double_posture(PROTOTYPE)
    offsets = np.array([0.6, -0.9, 0.3])
    rng = np.random.default_rng(6)
    clean = simulate(PROTOTYPE, offsets, plan) + rng.normal(0.0, 0.1, len(plan))
    for where in cause.places(plan, PROTOTYPE):
        acting = cause.at(np.zeros(0), where)
        zeros = rng.uniform(-4.0, 4.0, 6)[plan.setup]
        written = acting.record(clean + zeros, Commanded(PROTOTYPE, plan))
        frame = Frame.of(readings_of(PROTOTYPE, plan, written), PROTOTYPE)
        assert frame.relabelled(cause, where) == pytest.approx(frame.matrix @ clean, abs=1e-12)
        assert np.abs(frame.data - frame.matrix @ clean).max() > 0.1


def test_a_swap_pairs_readings_taken_at_the_same_time() -> None:
    """Whatever the order of the rows."""
    from orthoglide_cal.causes import Where

    plan = double_posture(PROTOTYPE)
    mixed = plan.subset(np.random.default_rng(2).permutation(len(plan)))
    swap = CAUSES["swapped_gauges"]
    assert isinstance(swap, RelabelCause)
    index, sign = swap.relabel(mixed, Where((1,)))
    assert np.all(sign == 1.0)
    changed = index != np.arange(len(plan))
    assert np.all(mixed.leg[changed] == 1)
    assert changed.sum() == 20
    assert np.all(mixed.hours[index] == mixed.hours)
    assert np.all(mixed.direction[index][changed] != mixed.direction[changed])
