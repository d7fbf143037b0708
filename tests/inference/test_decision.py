"""What is said of probabilities that are made up, each far from where the statement would change.

The machine, its causes and what they ask of a technician are real; how probable they are is not.
Trends over several dates have a library's densities.
"""

from dataclasses import replace
from functools import cache
from itertools import product
from math import log
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from orthoglide_cal.estimation.gaussian import mixture, probabilities
from orthoglide_cal.inference.diagnose import Diagnosis, diagnose
from orthoglide_cal.inference.hypothesis import Hypothesis
from orthoglide_cal.inference.patterns import pattern_candidates, scores_of
from orthoglide_cal.inference.sessions import SPREADS, DatedValues, Part, Trend, TrendFit, _fit
from orthoglide_cal.losses import state
from orthoglide_cal.schema import Reason
from tests import truth
from tests.cli.program import refusals
from tests.inference.sessions import changed, known


@cache
def session() -> Diagnosis:
    return Diagnosis.about(*known(truth.make_session(1, truth.PROTOTYPE, truth.DIAL)))


BEYOND = {"returning": "repeats leg x", "passing": "settles leg x"}


def decision(misfit: float = 0.0, likelier: float = 99.0, **shares: float) -> Diagnosis:
    """Of shares by ids joined with "_and_"; "nothing" is that nothing is wrong.

    Every explanation leaves residuals of `misfit` standard deviations. Where it fits best, one with
    more causes makes the data `likelier` times as likely.
    """
    at, fit = session().at, session().fit_of(())
    left = np.full(len(at.white), misfit * at.noise.stated)
    made, fits, patterns = {}, {}, {}
    for name, share in {"nothing": 1e-12, "returning": 1e-300, **shares}.items():
        if name in BEYOND:
            pattern = session().patterned[BEYOND[name]]
            patterns[pattern.label] = replace(pattern, log_evidence=log(share) - pattern.log_prior)
            continue
        ids = () if name == "nothing" else tuple(sorted(name.split("_and_")))
        evidence = log(share) - session().hypotheses[ids].log_prior
        made[ids] = replace(session().hypotheses[ids], log_evidence=evidence)
        likelihood = len(ids) * log(likelier)
        # No unknown follows what is left.
        leaves = {"linear": left, "columns": 0.0 * fit.columns, "log_positive": likelihood}
        fits[ids] = replace(fit, log_evidence=evidence, **leaves)
    short = {ids: fit.judged for ids, fit in fits.items()}
    return Diagnosis(session().measured, session().model, at, made, patterns, short, fits)


def said(found: Diagnosis) -> str:
    """The verdict, what is accepted, and what it cannot be told from."""
    accepted = f" {'+'.join(found.accepted)}" if found.accepted else ""
    return "".join((found.verdict, accepted, *(f" or {id}" for id in found.ambiguous_with)))


@pytest.mark.parametrize("line", refusals(Path(__file__).with_name("verdicts.txt")))
def test_verdicts(line: str) -> None:
    verdict, shares = line.split("|")
    made = {name: float(share) for name, share in (one.split("=") for one in shares.split())}
    assert said(decision(**made)) == verdict.strip()


def test_the_fit_that_was_asked_for_last_is_kept_however_large(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("orthoglide_cal.inference.belief.KEPT", 1)
    found = replace(session(), _kept={})
    assert found.fit_of(("axis_gap",)) is found.fit_of(("axis_gap",))


def test_more_noise_of_all_readings_needs_no_other_where() -> None:
    fit = session().fit_of(())
    every = pattern_candidates(fit, fine=False)
    (noise,) = (patterns for patterns in every if patterns[0].how == "scatters")
    (score,) = scores_of(fit, [[one for one in noise if not one.where]])
    assert score.log_evidence == pytest.approx(session().patterned["scatters"].log_evidence)


def test_under_a_refuted_name_as_much_may_return_as_is_left() -> None:
    """In the readings of each cell alike: by the estimator, beside the covariance of the noise."""
    refuted, pattern = Reason.of("refuted_left_out", ids=["axis_gap"]), BEYOND["returning"]
    patterns = {pattern: session().patterned[pattern]}
    verdict = replace(session(), patterned=patterns, refuted=refuted)
    white, ((_, fit),) = session().at.white, verdict.left_open
    variance = fit.residual @ fit.residual / (len(white) - 3)
    alike = white.plan.cells[:, None] == np.unique(white.plan.cells)
    # What the offsets are before there are data counts for nothing.
    known = np.append(np.zeros(3), 1.0 / fit.sizes[3:])
    weighed = np.vstack((fit.columns / fit.sigma, np.diag(known)))
    effect = np.linalg.pinv(weighed)[:3, : len(white)] / fit.sigma @ white.matrix @ alike
    beyond = verdict.offsets[1] - fit.offsets_covariance
    assert beyond == pytest.approx(variance * effect @ effect.T, rel=1e-6)


def test_what_may_be_there_unseen_is_mentioned() -> None:
    """Where its name costs less to read than the fault to miss."""
    found = decision(nothing=1.0, axis_gap=0.1, leg_length=0.005, bar_skew=2e-4)
    assert found.not_excluded == ("axis_gap", "leg_length")
    # Not what acts with another fault only, nor an exchange: what does not show moves nothing.
    found = decision(nothing=1.0, axis_gap_and_misread=0.1, swapped_gauges=0.1)
    assert found.not_excluded == ()


def test_what_is_active_stays_only_if_every_open_explanation_says_so() -> None:
    diagnosis = diagnose(*known(truth.make_session(1, truth.PROTOTYPE, truth.DIAL, offset_sd=0.0)))
    near = diagnosis.fit_of(())
    far = replace(near, start=near.start + 10.0 * diagnosis.std_mm)
    for fits, stays in (((near,), True), ((far, near), False), ((near, far), False)):
        shares = tuple((1.0 / len(fits), fit) for fit in fits)
        assert changed(diagnosis, left_open=shares).stays_entered is stays


class Again(Hypothesis):
    """Asks to take one reading again."""

    remedy = ((), (12,))


def test_explanations_of_one_remedy_are_one_answer() -> None:
    """A reading is wrong, by a turn or by any other amount; a knock asks for more."""

    def asking(*ids: str, **shares: float) -> Diagnosis:
        made = decision(**shares)
        again = {(id,): Again(**vars(made.hypotheses[id,])) for id in ids}
        return replace(made, hypotheses={**made.hypotheses, **again})

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


FLAT = 1e3  # a prior of the parameters that says nothing


@pytest.fixture
def dated() -> DatedValues:
    """Four sessions of two parameters, with what the first three have in common."""
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(4, 2, 2)) + 2.0 * np.eye(2)
    common = [{"legs": rng.normal(size=(2, 1))} if k < 3 else {} for k in range(4)]
    values = rng.normal(size=(4, 2)) + np.array([5.0, -3.0])
    values[2:, 0] += 9.0
    times = np.array([0.0, 1.0, 3.0, 7.0])
    return DatedValues(values, roots @ roots.swapaxes(1, 2), common, times, [range(2)])


def library_density(data: DatedValues, parts: list[Part], scatter: np.ndarray) -> float:
    """ln p of all values, every unknown integrated out, by scipy."""
    count, width = data.values.shape
    blocks = [one + np.diag(scatter**2) for one in data.covariance]
    spread = np.zeros((count * width, count * width))
    for k, block in enumerate(blocks):
        spread[k * width : (k + 1) * width, k * width : (k + 1) * width] = block
    columns = [np.tile(FLAT * np.eye(width), (count, 1))]
    columns.append(np.concatenate([one.get("legs", np.zeros((width, 1))) for one in data.common]))
    for part in parts:
        course = (np.arange(count) > part.at).astype(float)
        if part.trend is Trend.DRIFTING:
            course = (data.times - data.times.mean()) / 7.0
        unit = np.diag(part.size * data.unit)[:, list(part.subset)]
        columns.append(np.kron(course[:, None], unit))
    spread += sum(column @ column.T for column in columns)
    return float(multivariate_normal.logpdf(data.values.ravel(), cov=spread))


def test_evidence_is_the_density_of_the_values(dated: DatedValues) -> None:
    """Against that of "unchanged": what all hypotheses share cancels."""
    hypotheses = [
        ([Part(Trend.CHANGED, 1, (0,), 4.0)], np.zeros(2)),
        ([Part(Trend.DRIFTING, 0, (0, 1), 2.0)], np.zeros(2)),
        ([], np.array([0.0, 3.0])),
        ([Part(Trend.CHANGED, 0, (1,), 1.0), Part(Trend.DRIFTING, 0, (0,), 8.0)], np.ones(2)),
    ]
    none = TrendFit(dated, [], np.zeros(2)).log_evidence
    still = library_density(dated, [], np.zeros(2))
    for parts, scatter in hypotheses:
        gain = TrendFit(dated, parts, scatter).log_evidence - none
        assert gain == pytest.approx(library_density(dated, parts, scatter) - still, abs=1e-3)


def test_steps_between_the_same_sessions_are_one_of_all_that_changed() -> None:
    """Of x much more than of y and z: no parameter is shared between two steps there."""
    change, known = np.array([-1.49, -0.032, -0.367]), np.diag([0.008**2] * 3)
    both = np.stack([0.0 * change, change])
    data = DatedValues(both, np.stack([known, known]), [{}, {}], np.arange(2.0), [range(3)])
    ((step, sizes, _),) = _fit(data, (Trend.CHANGED,))[1].sizes(Trend.CHANGED)
    assert step.subset == (0, 1, 2)
    assert sizes == pytest.approx(change, abs=1e-6)


def test_one_more_step_is_the_mean_over_all_that_it_may_be(dated: DatedValues) -> None:
    fit = TrendFit(dated, [], np.zeros(2))
    every = [Part(Trend.CHANGED, *one) for one in product(range(3), dated.subsets, SPREADS)]
    logs = [TrendFit(dated, [part], fit.scatter).log_evidence for part in every]
    log, best = fit.one_more(Trend.CHANGED)
    gain = np.logaddexp.reduce(logs) - np.log(len(every)) - fit.log_evidence
    assert log == pytest.approx(gain, abs=1e-6)
    assert best == every[int(np.argmax(logs))]
    assert (best.at, best.subset) == (1, (0,))


def test_a_mixture_has_the_moments_of_what_is_drawn_from_it() -> None:
    """200,000 draws: each moment within five of its standard deviations."""
    shares = probabilities({"few": np.log(1.0), "many": np.log(3.0)})
    assert [*shares] == ["many", "few"]
    assert [*shares.values()] == pytest.approx([0.75, 0.25])
    means = [np.array([1.0, -2.0]), np.array([3.0, 1.0])]
    spreads = [np.array([[2.0, 0.5], [0.5, 1.0]]), np.diag([0.3, 0.1])]
    mean, covariance = mixture([*shares.values()], means, spreads)
    rng = np.random.default_rng(11)
    first = rng.random(200_000) < shares["many"]
    drawn = [rng.multivariate_normal(*pair, 200_000) for pair in zip(means, spreads, strict=True)]
    draws = np.where(first[:, None], *drawn)
    assert draws.mean(axis=0) == pytest.approx(mean, abs=0.025)
    assert np.cov(draws.T) == pytest.approx(covariance, abs=0.05)


def test_a_statement_has_the_least_expected_loss() -> None:
    """Of nothing against something."""
    rng = np.random.default_rng(5)
    stated = set()
    for shares in rng.dirichlet([1.0, 0.5, 0.5, 0.2], 200).tolist():
        belief = dict(zip(("nothing", "a", "b", "c"), shares, strict=True))
        choice, _ = state(belief, "nothing", 150.0, 600.0)
        losses = {"nothing": 150.0 * (1.0 - belief["nothing"]), "else": 600.0 * belief["nothing"]}
        least = min(losses, key=losses.__getitem__)
        likeliest = max("abc", key=belief.__getitem__)
        assert choice == (likeliest if least == "else" else "nothing")
        stated.add(choice)
    assert stated == {*belief}
