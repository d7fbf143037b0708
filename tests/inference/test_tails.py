"""Sizes have tails: what is larger than stated is named all the same."""

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.inference import Diagnosis, Verdict, diagnose
from tests import truth
from tests.inference.sessions import ids, known
from tests.inference.test_certainty import measured
from tests.truth.effects import Effect
from tests.truth.forward import MACHINE_CAUSES


def with_legs(legs: tuple[float, float, float], stated: float, seed: int) -> Diagnosis:
    """Legs that are off, with a stated size of them."""
    readings, model = known(measured(Effect("leg_length", "", legs), seed=seed))
    sizes = {**model.machine.tolerances, "leg_length": stated}
    return diagnose(readings, replace(model, machine=model.machine.changed(tolerances=sizes)))


@pytest.mark.parametrize("seed", [1])
def test_a_stated_size_hides_nothing(seed: int) -> None:
    """Legs 1.4 mm off: visible although 1 mm is stated; 0.3 mm are not, and count in U."""
    found = with_legs((1.4, -0.3, 0.5), 1.0, seed)
    assert (found.verdict, ids(found)) == (Verdict.NAMED, ["leg_length"])
    assert found.causes[0].times_stated is None
    lack = found.lack_of_fit
    assert lack.p_value < 1e-6
    assert lack.left_mm > 1.5 * lack.expected_mm
    hidden = with_legs((0.3, 0.0, 0.0), 1.0, seed)
    assert hidden.verdict is Verdict.CONSISTENT
    assert np.all(hidden.std_mm > 0.9)


def test_what_only_a_size_beyond_all_scales_explains_is_unexplained() -> None:
    """Legs 1.4 mm off, in a file that calls a micrometre plausible and nothing else."""
    session = measured(
        Effect("leg_length", "", (1.4, -0.3, 0.5)), seed=1, gauge=truth.DIAL, cycles=8
    )
    readings, model = known(session)
    sizes = dict.fromkeys(model.machine.tolerances, 0.0) | {"leg_length": 0.001}
    found = diagnose(readings, replace(model, machine=model.machine.changed(tolerances=sizes)))
    assert found.verdict is Verdict.UNEXPLAINED
    assert found.beyond_tolerance == ()


@pytest.mark.parametrize("cause", [c for c in MACHINE_CAUSES if c != "leg_length"])
def test_ten_and_thirty_times_the_stated_size_are_named(cause: str) -> None:
    for times, gauge in ((10.0, truth.MICRON), (30.0, truth.DIAL)):
        session = truth.make_session(31, truth.PROTOTYPE, gauge, (cause,), times=(times, times))
        found = diagnose(*known(session))
        assert (found.verdict, ids(found)) == (Verdict.NAMED, [cause])
        stated = found.causes[0].times_stated
        assert 0.4 * times < stated < 1.1 * times
