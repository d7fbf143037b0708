"""The readings so far as arrays: the same as in the file at the end, to the last digit."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.readings import session_text
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.model.readings import GaugePlan
from orthoglide_cal.planning.steps import MeasuringProtocol
from orthoglide_cal.session.events import Answered, Doubt, Event, GaugeLabel, replay
from orthoglide_cal.session.readings import ReadingsSoFar

from .virtual import (
    AT,
    DOUBLE,
    both_protocols,
    opened,
    questioned,
    random_events,
    read_next,
    readings_of,
    setting_of,
    state_of,
    steps_of,
    taken,
)

TWO = (GaugeLabel(id="MT-1", certificate="C 7"), GaugeLabel(id="MT-2"))


def so_far_of(
    events: Sequence[Event], protocol: MeasuringProtocol, **other: object
) -> ReadingsSoFar:
    first = opened(protocol, **other)  # type: ignore[arg-type]
    return ReadingsSoFar(replay([first, *events]), setting_of(steps_of(protocol)))


@both_protocols
@pytest.mark.parametrize("gauges", [(), TWO])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_live_readings_are_those_of_the_file(
    tmp_path: Path, seed: int, protocol: MeasuringProtocol, gauges: tuple[GaugeLabel, ...]
) -> None:
    """Whatever was retaken, skipped, undone, moved or kept in doubt."""
    events = random_events(seed, 200, len(steps_of(protocol)))
    so_far = so_far_of(events, protocol, gauges=gauges, temperature_c=20.5)
    live = so_far.measured
    exact = [item.take.minutes for item in so_far.state.accepted.values()]
    assert so_far.minutes == pytest.approx(exact, abs=5.1e-5)
    (tmp_path / "s.yaml").write_text(session_text(so_far.session), encoding="utf-8")
    read = read_input(str(tmp_path / "s.yaml"))
    filed = read.measured
    assert len(live) == len(so_far.state.accepted) > 15
    assert set(live.temperature) == {20.5}
    for item in fields(GaugePlan):
        assert np.array_equal(getattr(live.plan, item.name), getattr(filed.plan, item.name)), item
    for name in ("value", "cycle", "temperature"):
        one, other = getattr(live, name), getattr(filed, name)
        assert np.array_equal(one, other, equal_nan=True), name
    assert (live.posture, live.gauge, live.timed) == (filed.posture, filed.gauge, filed.timed)
    shown, solved = so_far.solution, solve(filed, read.model)
    assert shown.offsets_mm.tolist() == solved.offsets_mm.tolist()
    assert shown.budget.expanded_mm.tolist() == solved.budget.expanded_mm.tolist()


def test_too_few_readings_and_readings_that_no_file_takes_have_no_solution() -> None:
    steps, values = steps_of(), readings_of(steps_of())
    events = [taken(s.number, v) for s, v in zip(steps, values, strict=True)]
    assert so_far_of([], DOUBLE).solution is None
    assert so_far_of(events[:4], DOUBLE).solution is None
    assert so_far_of(events, DOUBLE).solution is not None
    assert so_far_of([*events[:-1], taken(60, 310.3)], DOUBLE).solution is None


def test_the_scatter_of_repeats_is_that_of_a_normal_distribution() -> None:
    """Five cycles of the ten readings of leg x, of which blunders and drifts are no part.

    The median of the absolute differences of successive repeats, divided by the one that two
    standard normal readings have: √2 · Φ⁻¹(3/4).
    """
    steps = steps_of(cycles=5)
    rng = np.random.default_rng(12)
    values = rng.normal(0.0, 0.05, 32) + np.array(
        [0.9 * s.leg + 0.1 * s.direction for s in steps[:32]]
    )
    values[7] += 3.0  # one slip
    events = [taken(k + 1, float(v), 0.1 * k) for k, v in enumerate(values)]
    so_far = ReadingsSoFar(state_of(events), setting_of(steps))
    jumps = []
    for cell in {step.cell for step in steps[:32]}:
        mine = [v for v, s in zip(values, steps[:32], strict=True) if s.cell == cell]
        jumps += np.abs(np.diff(mine)).tolist()
    assert len(jumps) >= 20
    expected = np.median(jumps) / (np.sqrt(2.0) * stats.norm.ppf(0.75))
    sigma = read_next(so_far.state, steps, 32, 5.0).sigma_mm
    assert sigma == pytest.approx(expected, rel=1e-4)
    assert sigma > 5.0 * so_far.setting.machine.gauge.noise_mm


def test_few_repeats_or_quiet_ones_leave_the_stated_noise() -> None:
    steps = steps_of(cycles=5)
    rng = np.random.default_rng(13)
    for count, spread in ((14, 0.05), (32, 1e-4)):
        values = rng.normal(0.0, spread, count)
        events = [taken(k + 1, float(v)) for k, v in enumerate(values)]
        now = read_next(state_of(events), steps, count, 5.0)
        assert now.sigma_mm == now.setting.machine.gauge.noise_mm


def test_what_was_kept_in_doubt_begins_the_comparison_anew() -> None:
    steps = steps_of()
    events = [
        *(taken(k, 0.1 * k) for k in range(1, 9)),
        questioned(taken(9, 1.7), Doubt.REVOLUTION, "really?"),
        Answered(at=AT, keep=True),
        *(taken(k, 0.1 * k) for k in range(10, 15)),
    ]
    now = read_next(state_of(events), steps, 14, 3.0)
    # Steps 9, 11, 13, 15 … are gauge Y's; what was kept at 9 is used for nothing.
    assert now.past.tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 9, 10, 11, 12, 13]
    assert now.series == [10, 12]
    assert now.fresh == [0] * 10 + [9, 0, 9, 0, 9]
    assert now.partner == now.setup[1]


def test_a_doubt_about_the_reading_itself_is_no_reason_for_that() -> None:
    kept = questioned(taken(25, 0.123), Doubt.GRID, "really?")
    events = [*(taken(k, 0.1 * k) for k in range(1, 25)), kept, Answered(at=AT, keep=True)]
    now = read_next(state_of(events), steps_of(), 25, 3.0)
    assert len(now.past) == 25
    assert now.settled == {Doubt.GRID}
