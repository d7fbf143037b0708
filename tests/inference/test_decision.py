"""What is said of probabilities that are made up, each far from where the statement would change.

The machine, its causes and what they ask of a technician are real; how probable they are is not.
"""

from dataclasses import replace
from functools import cache
from math import log
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.inference.belief import Belief
from orthoglide_cal.inference.data import Whitened
from orthoglide_cal.inference.decision import Decision
from orthoglide_cal.inference.hypothesis import Hypothesis
from orthoglide_cal.schema import Reason
from tests import truth
from tests.cli.program import refusals
from tests.inference.sessions import known


@cache
def session() -> Belief:
    return Belief.about(Whitened.of(*known(truth.make_session(1, truth.PROTOTYPE, truth.DIAL))))


BEYOND = {"returning": "repeats leg x", "passing": "settles leg x"}


def decision(misfit: float = 0.0, likelier: float = 99.0, **shares: float) -> Decision:
    """Of shares by ids joined with "_and_"; "nothing" is that nothing is wrong.

    Every explanation leaves residuals of `misfit` standard deviations. Where it fits best, one with
    more causes makes the data `likelier` times as likely.
    """
    at, fit = session().at, session().fit(())
    left = np.full(len(at.white), misfit * at.noise.stated)
    made, fits, patterns = {}, {}, {}
    for name, share in {"nothing": 1e-12, "returning": 1e-300, **shares}.items():
        if name in BEYOND:
            pattern = session().patterns[BEYOND[name]]
            patterns[pattern.label] = replace(pattern, log_evidence=log(share) - pattern.log_prior)
            continue
        ids = () if name == "nothing" else tuple(sorted(name.split("_and_")))
        evidence = log(share) - session().hypotheses[ids].log_prior
        made[ids] = replace(session().hypotheses[ids], log_evidence=evidence)
        likelihood = len(ids) * log(likelier)
        # No unknown follows what is left.
        leaves = {"linear": left, "columns": 0.0 * fit.columns, "log_positive": likelihood}
        fits[ids] = replace(fit, log_evidence=evidence, **leaves)
    return Decision(Belief(at, made, patterns, fits))


def said(found: Decision) -> str:
    """The verdict, what is accepted, and what it cannot be told from."""
    accepted = f" {'+'.join(found.accepted)}" if found.accepted else ""
    return "".join((found.verdict, accepted, *(f" or {id}" for id in found.ambiguous_with)))


@pytest.mark.parametrize("line", refusals(Path(__file__).with_name("verdicts.txt")))
def test_verdicts(line: str) -> None:
    verdict, shares = line.split("|")
    made = {name: float(share) for name, share in (one.split("=") for one in shares.split())}
    assert said(decision(**made)) == verdict.strip()


def test_under_a_refuted_name_as_much_may_return_as_is_left() -> None:
    """In the readings of each cell alike: by the estimator, beside the covariance of the noise."""
    refuted = Reason.of("refuted_left_out", ids=["axis_gap"])
    verdict = replace(decision(axis_gap=1.0, misfit=3.0), refuted=refuted)
    (_, fit), *_ = verdict.left_open
    white = session().at.white
    variance = fit.residual @ fit.residual / (len(white) - 3)
    alike = white.plan.cells[:, None] == np.unique(white.plan.cells)
    effect = fit.offsets_covariance @ fit.columns[:, :3].T @ white.matrix @ alike / fit.sigma**2
    beyond = verdict.offsets[1] - fit.offsets_covariance
    assert beyond == pytest.approx(variance * effect @ effect.T, rel=0.01)


def test_what_may_be_there_unseen_is_mentioned() -> None:
    """Where its name costs less to read than the fault to miss."""
    found = decision(nothing=1.0, axis_gap=0.1, leg_length=0.005, bar_skew=2e-4)
    assert found.not_excluded == ("axis_gap", "leg_length")
    # Not what acts with another fault only, nor an exchange: what does not show moves nothing.
    found = decision(nothing=1.0, axis_gap_and_misread=0.1, swapped_gauges=0.1)
    assert found.not_excluded == ()


def test_a_rival_a_little_below_the_bound_is_looked_at_again() -> None:
    found = decision(axis_gap=1.0, bar_skew=0.005, leg_length=0.1)
    assert found.nearly_dismissed(("bar_skew",))
    assert not found.nearly_dismissed(("leg_length",))
    assert not decision(axis_gap=1.0, misread=1e-9).nearly_dismissed(("misread",))
    besides = decision(axis_gap=1.0, axis_gap_and_misread=0.2)
    assert not besides.nearly_dismissed(("axis_gap", "misread"))


class Again(Hypothesis):
    """Asks to take one reading again."""

    remedy = ((), (12,))


def test_explanations_of_one_remedy_are_one_answer() -> None:
    """A reading is wrong, by a turn or by any other amount; a knock asks for more."""

    def asking(*ids: str, **shares: float) -> Decision:
        belief = decision(**shares).belief
        again = {(id,): Again(**vars(belief.hypotheses[id,])) for id in ids}
        return Decision(replace(belief, hypotheses={**belief.hypotheses, **again}))

    assert said(decision(misread=0.35, axis_gap=0.25)) == "ambiguous misread or axis_gap"
    slips = "gauge_slip", "misread"
    found = asking(*slips, gauge_slip=0.35, misread=0.25, misread_and_leg_length=0.02)
    assert said(found) == "named gauge_slip"
    assert found.same_answer(("gauge_slip",)) == (("misread",),)
    # Together they are likelier than what each alone is not.
    found = asking(*slips, gauge_slip=0.35, misread=0.25, axis_gap=0.4)
    assert said(found) == "ambiguous gauge_slip or axis_gap"
    # With its stand gone a knock that moved this reading alone is no more than a wrong reading.
    for share, name in ((0.15, "misread"), (1.5, "stand_shift")):
        found = asking("misread", "stand_shift", misread=0.3, stand_shift=share)
        assert said(found) == f"named {name}"
