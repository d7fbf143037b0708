"""Do the stated uncertainties hold? Sessions of the independent truth, blind: stands within about a
millimetre of their place, legs and gauge scale within their tolerances, offsets up to some mm."""

from collections import Counter

import pytest

from orthoglide_cal.inference import Verdict
from orthoglide_cal.results import Answer, answer_to
from tests import truth
from tests.bench.scoring import band
from tests.inference.sessions import given

# Standard deviation of the hidden joint offsets [mm]: one in twenty is beyond 2 mm.
OFFSETS = 1.0
GROUPS = [(machine, gauge) for machine in truth.MACHINES for gauge in truth.GAUGES]


def inside(found: Answer, session: truth.Session) -> int:
    """How many of the three offsets are within their expanded uncertainty."""
    pairs = zip(found.parameters, session.offsets.tolist(), strict=True)
    return sum(
        each.found is not None and abs(each.found - true) <= each.expanded for each, true in pairs
    )


@pytest.mark.slow
@pytest.mark.parametrize("cycles", [2, 3])
@pytest.mark.parametrize(("machine", "gauge"), GROUPS)
def test_healthy_sessions_are_consistent_and_their_intervals_hold(
    machine: str, gauge: str, cycles: int
) -> None:
    """250 sessions in each of eight groups, 2,000 in all.

    A coverage of 93 to 97 % fails in 1 of 500 groups; where one session in 200 is no longer
    consistent, 1 group in 300 has more than five such sessions.
    """
    count, covered, verdicts = 250, 0, Counter[str]()
    for seed in range(count):
        session = truth.make_session(
            8000 + seed,
            truth.MACHINES[machine],
            truth.GAUGES[gauge],
            offset_sd=OFFSETS,
            cycles=cycles,
        )
        found = answer_to(given(session))
        covered += inside(found, session)
        verdicts[str(found.verdict)] += 1
    low, high = band(count, 0.93, 0.97)
    assert low <= covered / (3 * count) <= high
    assert count - verdicts[Verdict.CONSISTENT] <= 5, verdicts
