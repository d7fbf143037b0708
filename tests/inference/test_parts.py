"""Diagnosis of readings of several sittings: a fault is one of a part, a cause one of all."""

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.inference import diagnose
from orthoglide_cal.model.cause import Place
from tests import truth
from tests.inference.sessions import known
from tests.truth import again


@pytest.mark.parametrize("fault", ["sign_flip", "swapped_gauges", "gauge_drift"])
def test_a_fault_is_named_with_its_part(fault: str) -> None:
    # A slow technician sees what creeps.
    session = truth.make_session(3, truth.PROTOTYPE, truth.MICRON, (fault,), pace=3.0)
    found = diagnose(*known(again(session)))
    assert [cause.id for cause in found.causes] == [fault]
    (effect,), (cause,) = session.effects, found.causes
    assert cause.where.endswith(", part 1")
    own = f"leg {effect.where[0]}" if effect.leg is not None else f"leg {effect.where[0]}, "
    assert cause.where.startswith(own)
    assert np.all(np.abs(found.offsets_mm - session.offsets) < 4.5 * found.std_mm)
    whole = diagnose(*known(session))
    assert whole.causes[0].where == cause.where.removesuffix(", part 1")


def test_places_of_the_parts() -> None:
    """Gauges of each part have their own faults; of the whole table none, where two were joined."""
    session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON)
    one, model = known(session)
    two, _ = known(again(session))
    both = {
        id: (cause.places(one.plan, model.machine), cause.places(two.plan, model.machine))
        for id, cause in CAUSES.items()
    }
    for id in ("sign_flip", "gauge_drift", "swapped_gauges"):
        single, joined = (tuple(p for p in each if p) for each in both[id])
        assert joined == (*single, *(Place((*place, 1)) for place in single))
    assert both["exchanged_columns"] == ((Place(),), ())
    assert both["wrong_unit"][1] == ()
    assert Place() in both["sign_flip"][0]
    assert Place() not in both["sign_flip"][1]
    swap, later = CAUSES["swapped_gauges"], Place((1, 1))
    index, _ = swap.relabel(two.plan, later)
    moved = index != np.arange(120)
    assert moved.tolist() == ((two.plan.leg == 1) & (two.plan.part == 1)).tolist()
    really = swap.really_read(two.plan, later)
    assert (really.direction != two.plan.direction).tolist() == moved.tolist()
    assert swap.label(later, two.plan, model.machine) == "leg y, part 2"
    flip = CAUSES["sign_flip"]
    _, signs = flip.relabel(two.plan, Place((0, 1, 1)))
    assert np.flatnonzero(signs < 0.0).tolist() == list(range(60, 80, 2))


def test_gauges_are_exchanged_only_where_the_step_was_the_same() -> None:
    """A reading with another offset entered is none of the same step."""
    session = truth.make_session(1, truth.PROTOTYPE, truth.MICRON)
    step = np.outer(np.arange(60) == 59, [0.5, 0.0, 0.0])
    readings, _ = known(again(session, entered=step))
    swap = CAUSES["swapped_gauges"]
    assert swap.reversible(readings.plan, Place((2,)))
    assert not swap.reversible(readings.plan, Place((2, 1)))
