"""Explanations against another program's numbers: how likely they are, and what they estimate.

The forward model is that of `tests.truth`; evidence is integrated, or sampled by dynesty.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.inference.belief import Belief
from orthoglide_cal.inference.data import Whitened
from tests import truth
from tests.cli.program import refusals
from tests.inference.sessions import known
from tests.truth.evidence import Evidence

Ids = tuple[str, ...]


@cache
def drawn(hidden: Ids, gauge: truth.Gauge = truth.DIAL) -> tuple[Evidence, Belief]:
    session = truth.make_session(3, truth.PROTOTYPE, gauge, hidden)
    return Evidence(session), Belief.about(Whitened.of(*known(session)))


@pytest.mark.parametrize("line", refusals(Path(__file__).with_name("explained.txt")))
def test_evidence_is_that_of_another_forward_model(line: str) -> None:
    """Odds to 5 %: σ is integrated here and summed there, and what is far below it is left out."""
    ids, hidden = (tuple(part.split()) for part in line.split("|"))
    other, found = drawn(hidden)
    expected = other.integrated(list(other.cases(ids)))
    assert found.hypotheses[ids].log_evidence == pytest.approx(expected, abs=0.05)
    assert found.fit(ids).log_evidence == pytest.approx(expected, abs=0.05)


def test_widths_of_lost_motion_are_not_negative() -> None:
    """All three are clearly positive here, which makes it 8 times as likely."""
    other, found = drawn(("backlash",), truth.MICRON)
    cases = list(other.cases(("backlash",)))
    expected = other.integrated(cases)
    free = other.integrated([replace(case, positive=0) for case in cases])
    assert expected - free == pytest.approx(np.log(8.0), abs=0.1)
    assert found.fit(("backlash",)).log_evidence == pytest.approx(expected, abs=0.1)


def test_evidence_of_what_is_not_listed() -> None:
    """What returns with the posture, or scatters more: to 20 % of the odds.

    What is uncertain of every session is taken as large as the noise, which costs that much.
    """
    other, found = drawn(())
    for label, cases in other.patterns().items():
        log = found.patterns[label].log_evidence
        assert log == pytest.approx(other.integrated(cases), abs=0.2), label


@pytest.mark.parametrize(
    "ids",
    [
        ("gauge_drift",),
        *(
            pytest.param((id,), marks=pytest.mark.slow)
            for id in ("axis_gap", "backlash", "misread", "swapped_gauges", "thermal_drift")
        ),
    ],
    ids="+".join,
)
def test_evidence_is_that_of_dynesty(ids: Ids) -> None:
    """To 5 of its standard errors, one false failure in a million, and 5 % of the odds."""
    gauge = truth.MICRON if ids == ("backlash",) else truth.DIAL
    other, found = drawn(ids, gauge)
    expected, error = other.sampled(list(other.cases(ids)), seed=1, live=200)
    assert error < 0.3
    assert found.fit(ids).log_evidence == pytest.approx(expected, abs=5.0 * error + 0.05)


@pytest.mark.parametrize(
    "ids",
    [
        (),
        ("axis_squareness", "bar_skew"),
        ("axis_gap", "stand_shift"),
        ("bar_skew", "swapped_gauges"),
    ],
    ids="+".join,
)
def test_offsets_and_parameters_are_those_of_another_forward_model(ids: Ids) -> None:
    """The most probable case of it, linear about the truth there and about the fit here.

    Values to 0.05 standard deviations, and these to 1 %.
    """
    other, found = drawn(ids)
    fit = found.fit(ids)
    case = max(other.cases(ids), key=lambda case: other.integrated([case]))
    mean, covariance = other.estimated(case, fit.sigma)
    std, end = np.sqrt(np.diag(covariance)), 3
    assert fit.offsets == pytest.approx(mean[:3], abs=0.05 * std[:3].min())
    allowed = 0.02 * np.outer(std, std)
    assert np.all(np.abs(fit.offsets_covariance - covariance[:3, :3]) < allowed[:3, :3])
    for effect in (one for one in fit.effects if one.covariance is not None):
        own, unit = slice(end, end := end + effect.theta.size), effect.cause.scale
        assert np.all(np.abs(effect.theta / unit - mean[own]) < 0.05 * std[own])
        error = effect.covariance / unit**2 - covariance[own, own]
        assert np.all(np.abs(error) < allowed[own, own])
    assert end == len(mean)
