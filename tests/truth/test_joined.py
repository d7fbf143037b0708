"""More readings at the same machine: what stays, what is over, where the carriages come from."""

import numpy as np
import pytest

from . import DIAL, MICRON, PROTOTYPE, Session, again, continue_session, make_session, readings_csv
from .effects import state_with
from .forward import signals
from .session import SITTING


def about_zeros(session: Session, values: np.ndarray) -> np.ndarray:
    """Values less those at the first reading of their set-up."""
    return np.asarray(values - values[session.plan.stand])


def drawn(*hidden: str, seed: int = 3, exact: bool = True) -> Session:
    return make_session(seed, PROTOTYPE, MICRON, hidden, exact=exact)


def test_the_first_readings_stay_and_the_new_ones_have_their_own_zeros() -> None:
    first = drawn(exact=False)
    both = again(first)
    assert both.readings[:60].tolist() == first.readings.tolist()
    assert both.plan.zero.tolist() == [k + one for k in range(0, 12, 2) for one in (0, 1) * 10]
    assert both.zeros[:6].tolist() == first.zeros.tolist()
    assert np.abs(both.zeros[6:] - first.zeros).min() > 1e-3
    assert both.setting.misplaced.shape == (12,)
    clean = about_zeros(both, both.clean)
    assert clean[60:] == pytest.approx(clean[:60], abs=1e-12)
    left = both.readings - both.clean
    assert np.abs(left).max() > 0.0
    exact = again(drawn())
    assert (exact.readings - exact.clean)[60:].std() == pytest.approx(MICRON.sigma, rel=0.3)


@pytest.mark.parametrize("cause", ["sign_flip", "swapped_gauges", "gauge_drift", "stand_shift"])
def test_what_happened_to_a_gauge_ends_with_its_part(cause: str) -> None:
    """In the same part it goes on; in the next one it is over."""
    first = drawn(cause)
    healthy = signals(first.plan, PROTOTYPE, state_with(first.offsets, ())[None])[0]
    usual = healthy - healthy[first.plan.stand]
    after, on = again(first), again(first, part=0)
    assert about_zeros(after, after.clean)[60:] == pytest.approx(usual, abs=1e-9)
    going_on = about_zeros(on, on.clean)
    assert np.abs(going_on[60:] - usual).max() > 0.02
    if cause in ("sign_flip", "swapped_gauges"):
        assert on.clean[60:] == pytest.approx(first.clean, abs=1e-9)
    elif cause == "stand_shift":
        (effect,) = first.effects
        knocked = first.plan.setup == effect.setup
        assert (going_on[60:] - usual) == pytest.approx(knocked * effect.parameters[0], abs=1e-9)


def test_carriages_come_from_where_they_were() -> None:
    first = drawn("backlash")
    # From the last posture (leg z at iso) to leg x at min, then back by an offset at iso.
    rows = [(0, PROTOTYPE.lower, 0.0), (0, 0.0, 0.0), (0, 0.0, 0.5)]
    leg, displacement, step = (np.array(column) for column in zip(*rows, strict=True))
    none = np.zeros(3, dtype=int)
    both = continue_session(
        first, 1, leg=leg, direction=none + 1, displacement=displacement, gauge_at=none + 0.5,
        order=np.arange(3), hours=2.0 + np.arange(3) / 60.0, part=none, turned=none,
        entered=np.outer(step, [1.0, 0.0, 0.0]),
    )  # fmt: skip
    assert both.plan.approach[:60].tolist() == first.plan.approach.tolist()
    assert both.plan.approach[60:].tolist() == [[-1, -1, -1], [1, 1, 1], [-1, 1, 1]]


def test_a_set_up_may_lack_the_isotropic_posture() -> None:
    first = drawn("axis_squareness", "encoder_scale")
    whole = again(first, gauge_at=0.25)
    away = first.plan.displacement != 0.0
    arrays = {name: getattr(whole.plan, name)[60:][away] for name in (*SITTING, "hours")}
    some = continue_session(first, 1, order=np.arange(away.sum()), **arrays)
    expected = whole.clean[60:][away] - whole.zeros[whole.plan.zero[60:][away]]
    assert some.clean[60:] - some.zeros[some.plan.zero[60:]] == pytest.approx(expected, abs=1e-9)


def test_readings_are_taken_in_their_order() -> None:
    first = drawn(exact=False)
    plain = again(first)
    plan, new = plain.plan, np.random.default_rng(0).permutation(60)
    arrays = {name: getattr(plan, name)[60:][new] for name in (*SITTING, "hours")}
    shuffled = continue_session(first, 1, order=new, **arrays)
    assert shuffled.readings.tolist() == plain.readings.tolist()


def test_the_file_tells_of_the_parts_and_only_where_there_are_some() -> None:
    first = make_session(2, PROTOTYPE, DIAL)
    assert readings_csv(first).splitlines()[0].endswith("reading_mm")
    both = again(first, turned=1, entered=(0.5, 0.0, -0.2), gauge_at=0.25)
    lines = readings_csv(both).splitlines()
    assert lines[1].endswith("0.500000,1,,0.000000 0.000000 0.000000")
    assert lines[61].endswith("0.250000,2,turned,0.500000 0.000000 -0.200000")


def test_nobody_knows_what_an_unlisted_effect_does_next() -> None:
    with pytest.raises(ValueError, match="outside the list"):
        again(make_session(1, PROTOTYPE, DIAL, outside="screw_period"))
