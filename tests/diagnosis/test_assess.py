"""From probabilities to a verdict and to offsets; the verdicts on probabilities made up."""

from dataclasses import replace
from math import exp, log

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis.assess import (
    BEYOND_TWO,
    DISMISSED,
    ODDS_TO_NAME,
    WITHOUT_SIZE,
    Posterior,
    assess,
    judge,
    probabilities,
)
from orthoglide_cal.diagnosis.candidates import UNLISTED, Candidates, Ids
from orthoglide_cal.diagnosis.explanations import Whitened
from orthoglide_cal.diagnosis.result import Verdict
from orthoglide_cal.files.input import read_input
from orthoglide_cal.model.model import Model
from tests import truth
from tests.diagnosis.sessions import known
from tests.machines import NOMINAL, PROTOTYPE, SAMPLES, extended

FITS = 0.3  # chance of the misfit of an explanation that leaves no more than noise


def posterior(unlisted: float = 0.0, **listed: float) -> Posterior:
    """Shares by ids joined with "_and_"; "nothing" is (); normalised."""
    keys = {
        (): listed.pop("nothing", 1e-12),
        **{tuple(sorted(k.split("_and_"))): v for k, v in listed.items()},
    }
    total = sum(keys.values()) + unlisted
    return Posterior({k: v / total for k, v in keys.items()}, {"a pattern": unlisted / total})


def judged(shares: Posterior, chance: float = FITS) -> str:
    """The verdict, what is accepted, and what it cannot be told from."""
    found = judge(shares, chance)
    accepted = f" {'+'.join(found.accepted)}" if found.accepted else ""
    return "".join((found.verdict, accepted, *(f" or {id}" for id in found.ambiguous_with)))


@pytest.mark.parametrize(
    ("shares", "verdict"),
    [
        (posterior(axis_gap=1.0, bar_skew=0.5 * DISMISSED), "named axis_gap"),
        (posterior(axis_gap=1.0, bar_skew=2.0 * DISMISSED, misread=0.3),
         "ambiguous axis_gap or misread or bar_skew"),
        # A second cause beside the best one does not contradict it, nor does a second one beside a
        # rival say more than the rival itself.
        (posterior(axis_gap=1.0, axis_gap_and_leg_length=0.2), "named axis_gap"),
        (posterior(axis_gap=1.0, bar_skew=0.2, bar_skew_and_misread=0.1),
         "ambiguous axis_gap or bar_skew"),
        # Of a pair only the doubtful part is doubted.
        (posterior(axis_gap_and_misread=1.0, axis_gap_and_stand_shift=0.8),
         "ambiguous axis_gap+misread or stand_shift"),
        # A second cause is added only where the odds demand it.
        (posterior(axis_gap=1.0, axis_gap_and_bar_skew=0.9 / ODDS_TO_NAME), "named axis_gap"),
        (posterior(axis_gap=1.0, axis_gap_and_bar_skew=0.9 * ODDS_TO_NAME),
         "ambiguous axis_gap or bar_skew"),
        (posterior(axis_gap=1.0, axis_gap_and_bar_skew=1.1 * ODDS_TO_NAME),
         "named axis_gap+bar_skew"),
        # Where more is asked for a cause more is asked for a second.
        (replace(posterior(axis_gap=1.0, axis_gap_and_bar_skew=1.5 * ODDS_TO_NAME),
                 odds=2.0 * ODDS_TO_NAME), "ambiguous axis_gap or bar_skew"),
        # An exchange happened or it did not: it cannot be too small to be seen.
        (posterior(bar_skew=1.0, bar_skew_and_swapped_gauges=2.0 * WITHOUT_SIZE),
         "ambiguous bar_skew or swapped_gauges"),
        (posterior(bar_skew=1.0, bar_skew_and_swapped_gauges=0.5 * WITHOUT_SIZE),
         "named bar_skew"),
        # A pattern beyond the list wins; nor is a cause named that cannot be told from it.
        (posterior(unlisted=2.0, axis_gap=1.0), "unexplained"),
        (posterior(unlisted=2.0 * DISMISSED, axis_gap=1.0), "unexplained"),
        (posterior(unlisted=0.5, axis_gap=1.0, bar_skew=0.5), "ambiguous axis_gap or bar_skew"),
        (posterior(unlisted=0.5 * DISMISSED, axis_gap=1.0), "named axis_gap"),
        # Beside two causes it has to be excluded.
        (posterior(unlisted=2.0 * BEYOND_TWO, axis_gap_and_misread=1.0), "unexplained"),
        (posterior(unlisted=0.5 * BEYOND_TWO, axis_gap_and_misread=1.0), "named axis_gap+misread"),
    ],
)  # fmt: skip
def test_verdicts(shares: Posterior, verdict: str) -> None:
    assert judged(shares) == verdict


def test_the_best_of_bad_explanations_is_none() -> None:
    assert judged(posterior(axis_gap=1.0), 1e-6) == "unexplained"


def test_nothing_is_named_before_the_odds_are_reached() -> None:
    """What would have been seen is not mentioned either."""
    below, rare = 0.5 * ODDS_TO_NAME, 1e-6
    shares = posterior(nothing=1.0, axis_gap=below, leg_length=0.06, bar_skew=rare)
    assert judged(shares) == "consistent"
    assert judge(shares, FITS).not_excluded == ("axis_gap", "leg_length")
    assert judged(posterior(nothing=1.0, axis_gap=1.1 * ODDS_TO_NAME)) == "named axis_gap"


def test_a_rival_a_little_below_the_bound_is_looked_at_again() -> None:
    shares = posterior(axis_gap=1.0, bar_skew=0.5 * DISMISSED, leg_length=2.0 * DISMISSED)
    assert shares.nearly_dismissed(("bar_skew",))
    assert not shares.nearly_dismissed(("leg_length",))
    assert not posterior(axis_gap=1.0, misread=1e-9).nearly_dismissed(("misread",))
    beside = posterior(axis_gap=1.0, axis_gap_and_misread=0.5 * DISMISSED)
    assert not beside.nearly_dismissed(("axis_gap", "misread"))


def test_explanations_of_one_remedy_are_one_answer() -> None:
    """Reading 12 is wrong, by a turn or by any other amount; a knock asks for more."""
    again = {("gauge_slip",): ((), (12,)), ("misread",): ((), (12,))}
    shares = posterior(gauge_slip=0.35, misread=0.25, misread_and_leg_length=0.02)
    assert judged(shares) == "ambiguous gauge_slip or misread"
    assert judged(replace(shares, remedies=again)) == "named gauge_slip"
    assert replace(shares, remedies=again).same_answer(("gauge_slip",)) == (("misread",),)
    # With its stand gone a knock that moved this reading alone is no more than a wrong reading.
    knock = {**again, ("stand_shift",): ((), (12,))}
    for misread, knocked, name in (
        (0.47, 0.53, "misread"),
        (0.3, 0.31 * ODDS_TO_NAME, "stand_shift"),
    ):
        shares = posterior(misread=misread, stand_shift=knocked)
        assert judged(replace(shares, remedies=knock)) == f"named {name}"
    # Together they are likelier than what each alone is not.
    shares = posterior(gauge_slip=0.35, misread=0.25, stand_shift=0.4)
    assert judged(replace(shares, remedies=again)) == "ambiguous gauge_slip or stand_shift"


def test_bayes_rule_with_the_weights_of_the_candidates() -> None:
    weights = {(): log(0.5), ("misread",): log(0.2)}
    shares = probabilities({(): 3.0, ("misread",): 5.0}, weights, {"p": 4.0, "q": 2.0})
    found = Posterior(*shares, odds=1.0)
    parts = [0.5 * exp(3.0), 0.2 * exp(5.0), exp(4.0), exp(2.0)]
    got = [found.listed[()], found.listed["misread",], found.unlisted["p"], found.unlisted["q"]]
    assert got == pytest.approx([part / sum(parts) for part in parts])
    assert found.best == ("misread",)


OWN = {id: cause for id, cause in CAUSES.items() if type(PROTOTYPE) in cause.sizes}


def tried(model: Model, ordered: bool = True) -> set[Ids]:
    return set(Candidates.of(model, ordered).log_prior)


class TestCandidates:
    def test_two_machine_causes_never_stand_together(self) -> None:
        measured = {id for id, cause in OWN.items() if not cause.in_machine}
        pairs = [ids for ids in tried(NOMINAL) if len(ids) == 2]
        assert all(measured & set(ids) for ids in pairs)
        machine = set(OWN) - measured
        # Every cause of the machine with every one of the contact or the record.
        wanted = {tuple(sorted((a, b))) for a in machine for b in measured}
        assert wanted <= set(pairs)
        assert {(c,) for c in OWN} <= tried(NOMINAL)
        # What another kind of machine can have is not tried.
        assert {id for ids in tried(NOMINAL) for id in ids} == set(OWN) < set(CAUSES)

    def test_weights_are_probabilities(self) -> None:
        weights = Candidates.of(NOMINAL, ordered=True).log_prior
        assert sum(map(exp, weights.values())) + UNLISTED == pytest.approx(1.0)

    def test_only_what_can_be_is_tried(self) -> None:
        timed = {id for id, cause in CAUSES.items() if cause.timed}
        assert timed >= {"backlash", "thermal_drift", "gauge_drift", "stand_shift"}
        assert not any(timed & set(ids) for ids in tried(NOMINAL, ordered=False))
        gauge = PROTOTYPE.gauge.changed(revolution_mm=None)
        assert ("gauge_slip",) not in tried(Model(PROTOTYPE.changed(gauge=gauge)))
        none = dict.fromkeys(OWN, 0.0)
        few = Model(PROTOTYPE.changed(tolerances={**none, "axis_gap": 0.3, "misread": 0.1}))
        assert tried(few) == {(), ("axis_gap",), ("misread",), ("axis_gap", "misread")}
        assert tried(Model(PROTOTYPE.changed(tolerances=none))) == {()}
        assert tried(Model(PROTOTYPE.changed(tolerances={}))) == tried(NOMINAL)

    def test_what_is_known_of_the_machine_is_not_tried_again(self) -> None:
        known_gap = extended(axis_gap=(0.1, 0.2, -0.1))
        assert not any("axis_gap" in ids for ids in tried(known_gap))
        assert any("bar_skew" in ids for ids in tried(known_gap))


class TestOffsets:
    @pytest.mark.parametrize("verdict", [Verdict.AMBIGUOUS, Verdict.NAMED])
    def test_an_open_choice_is_part_of_the_uncertainty(self, verdict: Verdict) -> None:
        """Moments of the mixture, E(x xᵀ) − E(x) E(x)ᵀ, or of the one explanation.

        Those of the paper's third experiment differ in the offsets by more than each leaves open:
        most of the uncertainty lies between them.
        """
        measured, model = read_input(str(SAMPLES / "experiment3.csv")).measured, NOMINAL
        if verdict is Verdict.NAMED:
            gap = truth.make_session(1, truth.PROTOTYPE, truth.MICRON, ("axis_gap",))
            measured, model = known(gap)
        found = assess(Whitened.of(measured, model))
        assert found.judgement.verdict is verdict
        mean, square, within, total = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3)), 0.0
        accepted = found.judgement.accepted
        same = found.posterior.same_answer(accepted)
        for ids in (accepted, *same, *found.posterior.rivals()):
            fit, weight = found.fit(ids), found.posterior.listed[ids]
            own = fit.covariance[:3, :3]
            mean += weight * fit.offsets
            square += weight * (own + np.outer(fit.offsets, fit.offsets))
            within += weight * own
            total += weight
        offsets, covariance = found.offsets
        assert offsets == pytest.approx(mean / total, rel=1e-12)
        expected = square / total - np.outer(offsets, offsets)
        assert covariance == pytest.approx(expected, rel=1e-9, abs=1e-12)
        widened = np.diag(covariance) / np.diag(within / total)
        assert np.sort(widened)[1] > 2.0 or verdict is Verdict.NAMED

    @pytest.mark.parametrize("outside", truth.OUTSIDE)
    def test_the_unexplained_widens_them_to_a_covariance(self, outside: str) -> None:
        session = truth.clear_outside(1, truth.PROTOTYPE, truth.MICRON, outside)
        found = assess(Whitened.of(*known(session)))
        assert found.judgement.verdict is Verdict.UNEXPLAINED
        _, covariance = found.offsets
        assert covariance == pytest.approx(covariance.T)
        assert np.linalg.eigvalsh(covariance).min() > 0.0
        fit, pattern = found.fit(()), max(found.unlisted, key=lambda one: one.log_evidence)
        spread = pattern.sigma**2 * np.eye(len(fit.residual)) + pattern.columns @ pattern.columns.T
        estimator = np.linalg.pinv(fit.columns[:, :3])
        likeliest = np.sqrt(np.diag(estimator @ spread @ estimator.T))
        assert np.all(np.sqrt(np.diag(covariance)) >= likeliest * (1.0 - 1e-12))
