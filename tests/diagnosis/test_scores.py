"""Scores and fits of explanations: by brute force, by another linearisation, by samples."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES, PatternCause, RelabelCause
from orthoglide_cal.diagnosis.assess import Assessment, assess
from orthoglide_cal.diagnosis.candidates import UNLISTED, Ids
from orthoglide_cal.diagnosis.evidence import NoiseGrid
from orthoglide_cal.diagnosis.explanations import Whitened
from orthoglide_cal.diagnosis.fit import Fitted
from orthoglide_cal.model.cause import Cause, Effect
from orthoglide_cal.model.model import simulate
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import GaugePlan
from tests import truth
from tests.diagnosis.sessions import known
from tests.diagnosis.test_evidence import dense
from tests.machines import sure

# What is assumed before any reading is seen, stated once more: one standard deviation of an
# offset, sizes of a blunder in tolerances, sizes of all other faults with their shares, in how many
# cases all parameters of a cause act, sizes of a pattern beyond the list in standard deviations of
# one reading.
OFFSET_MM = 10.0
BLUNDERS = (1.0, 6.0)
SCALES = {1.0: 0.8, 3.0: 0.17, 30.0: 0.03}
# Beside another fault causes are not far beyond their size.
USUAL = {1.0: 0.8 / 0.97, 3.0: 0.17 / 0.97}
ALL = 0.5
PATTERN_SIZES = (5.0, 30.0)
NOISIER = (2.0, 4.0, 8.0)


def _joint_covariance(fit: Fitted, effects: Sequence[Effect]) -> Floats:
    """Of the offsets and the parameters of some of its effects in turn, internal units."""
    slots = [fit.slots[fit.effects.index(effect)] for effect in effects]
    chosen = np.r_[(slice(0, fit.offsets.size), *slots)]
    return np.asarray(fit.covariance[np.ix_(chosen, chosen)])


@cache
def assessed(hidden: tuple[str, ...], seed: int, exact: bool = False) -> Assessment:
    """A session; where it is exact nothing but noise is uncertain."""
    session = truth.make_session(seed, truth.PROTOTYPE, truth.DIAL, hidden, exact=exact)
    readings, model = known(session)
    return assess(Whitened.of(readings, sure(model) if exact else model))


def averaged(
    noise: NoiseGrid,
    columns: Floats,
    residual: Floats,
    last: int = 0,
    scales: dict[float, float] = SCALES,
) -> float:
    """Evidence with a dense covariance for each scale of all but three columns, and each σ.

    The last ones, of what is uncertain of the data, have no scale either.
    """
    logs = [
        np.log(share) + weight + dense(widened(columns, scale, last), sigma, residual)
        for scale, share in scales.items()
        for weight, sigma in zip(noise.log_weight, noise.sigma.tolist(), strict=True)
    ]
    return float(np.logaddexp.reduce(logs))


def widened(columns: Floats, scale: float, last: int = 0) -> Floats:
    """Columns of offsets and parameters with the parameters' sizes multiplied."""
    sizes = np.ones(columns.shape[1])
    sizes[3 : len(sizes) - last] = scale
    return columns * sizes


def linear_model(
    found: Assessment, base: tuple[Cause, ...], given: Sequence[Effect] = ()
) -> tuple[Floats, Floats]:
    """Residual of the offsets-only fit and B of the base, by finite differences of simulate.

    The last columns are those of what is uncertain beside noise: legs, stands, scale; `given` is
    there whatever else is.
    """
    white = found.at.white
    model, plan = white.problem.model.extended(given), white.plan
    start = found.at.offsets[0]
    assert white.problem.remaining(white.data, start) < 1e-6
    step = 1e-4
    columns = [
        (simulate(model, start + d, plan) - simulate(model, start - d, plan))
        / (2.0 * step)
        * OFFSET_MM
        for d in step * np.eye(3)
    ]
    legs = CAUSES["leg_length"]
    for cause in (*base, legs):
        for k, std in enumerate(cause.prior_std(model.machine)):
            d = step * cause.scale * np.eye(cause.unknowns)[k]
            up = simulate(model.extended([cause.at(d)]), start, plan)
            down = simulate(model.extended([cause.at(-d)]), start, plan)
            columns.append((up - down) / (2.0 * step * cause.scale) * std)
    gauge = model.machine.gauge
    share = step / model.machine.leg_length_mm
    for setup in range(plan.setups):
        moved = share * (plan.setup == setup)
        up, down = (
            simulate(model, start, replace(plan, gauge_at=plan.gauge_at + d))
            for d in (moved, -moved)
        )
        columns.append((up - down) / (2.0 * step) * gauge.placement_std_mm)
    columns.append(gauge.scale_std * simulate(model, start, plan))
    residual = white.data - white.matrix @ simulate(model, start, plan)
    return residual, white.matrix @ np.stack(columns, axis=1)


def one_alone(
    noise: NoiseGrid, cause: Cause, columns: Floats, residual: Floats, last: int
) -> float:
    """Evidence of one parameter acting alone, whichever it is; columns: offsets, then the cause."""
    ends = 3, 3 + len(cause.names)
    parts = columns[:, : ends[0]], columns[:, ends[1] :]
    each = [
        averaged(noise, np.column_stack((parts[0], one, parts[1])), residual, last)
        for one in columns[:, ends[0] : ends[1]].T
    ]
    return float(np.logaddexp.reduce(each) - np.log(len(each)))


def either(together: float, single: float) -> float:
    return float(np.logaddexp(np.log(ALL) + together, np.log(1.0 - ALL) + single))


def faults(found: Assessment, cause: Cause, residual: Floats) -> Iterator[tuple[Floats, ...]]:
    """Of a fault with places: ln of their shares (p,), what is left (k, p), more columns (k, m)."""
    white, none = found.at.white, np.zeros((len(residual), 0))
    plan, machine = white.plan, white.machine
    places = cause.places(plan, machine)
    if isinstance(cause, RelabelCause):
        shares = [cause.share(place) for place in places]
        begin = found.at.extras[cause.id].own.start
        left = found.at.residuals[begin : begin + len(places)]
        yield np.log(shares) - np.log(sum(shares)), np.transpose(left), none
        return
    assert isinstance(cause, PatternCause)
    still, patterns = np.zeros(len(plan)), []
    for place in places:
        one = cause.at(np.ones(1), place)
        shown = cause.contact(still, one, still, plan, machine)
        patterns.append(white.matrix @ cause.record(shown, one, plan, machine))
    if cause.id == "gauge_slip":
        for turns, often in cause.counts.items():
            share = np.full(len(places), np.log(often / len(places)))
            yield share, residual[:, None] - turns * np.transpose(patterns), none
        return
    share = -np.log([len(BLUNDERS) * len(places)])
    for pattern, blunder in product(patterns, BLUNDERS):
        size = blunder * machine.tolerances[cause.id]
        yield share, residual[:, None], size * pattern[:, None]


def by_brute_force(found: Assessment, ids: Ids) -> float:
    """Evidence of a set, every σ, place and size one by one with a dense covariance."""
    plan, machine, noise = found.at.white.plan, found.at.white.machine, found.at.noise
    causes = [CAUSES[id] for id in ids]
    placed = [each for each in causes if not each.names or len(each.places(plan, machine)) > 1]
    base = tuple(each for each in causes if each not in placed)
    residual, columns = linear_model(found, base)
    last = CAUSES["leg_length"].unknowns + plan.setups + 1
    if not placed:
        scales = USUAL if len(base) > 1 else SCALES
        together = averaged(noise, columns, residual, last, scales)
        if len(base) == 1:
            return either(together, one_alone(noise, base[0], columns, residual, last))
        return together + (float(np.log(ALL)) if base else 0.0)
    (fault,) = placed
    parts = [
        weight + np.log(chance) + share + dense(np.hstack((wide, more)), sigma, left)
        for scale, chance in USUAL.items()
        for wide in (widened(columns, scale, last),)
        for share, left, more in faults(found, fault, residual)
        for weight, sigma in zip(noise.log_weight, noise.sigma.tolist(), strict=True)
    ]
    return float(np.logaddexp.reduce(np.concatenate(parts))) + len(base) * float(np.log(ALL))


@pytest.mark.parametrize(
    ("exact", "close"),
    [(True, {"abs": 2e-3, "rel": 1e-6}), (False, {"abs": 0.05, "rel": 3e-4})],
    ids=["exact", "real"],
)
@pytest.mark.parametrize(
    "ids",
    [
        (),
        ("axis_gap",),
        ("backlash",),
        ("gauge_drift",),
        ("gauge_slip",),
        ("sign_flip",),
        ("exchanged_columns",),
        ("axis_squareness", "bar_skew"),
        ("axis_gap", "stand_shift"),
        ("encoder_scale", "swapped_gauges"),
    ],
    ids="+".join,
)
def test_scores_are_brute_force_by_another_way(
    ids: Ids, exact: bool, close: dict[str, float]
) -> None:
    """With all places, all sizes and all σ of the grid, the derivatives by finite differences.

    What is uncertain of the data and far below the noise is left out of the scores; where an
    explanation fits as badly as the slip of a gauge here it is a fraction of that.
    """
    found = assessed(("axis_gap", "stand_shift"), 5, exact)
    score = found.scores[ids].log_evidence
    assert score == pytest.approx(by_brute_force(found, ids), **close)


def patterns(plan: GaugePlan) -> Iterator[Floats]:
    """Roots (n, m) of the covariances of patterns beyond the list, for one unit of their size.

    Independent of each other from cell to cell; a random walk within each set-up that has come to
    one unit at the end of the longest; independent readings of one leg.
    """
    cell = np.stack((plan.leg, plan.direction, plan.displacement), axis=1)
    yield np.stack([(cell == one).all(axis=1) for one in np.unique(cell, axis=0)], axis=1)
    steps = (plan.setup[:, None] == plan.setup) & (plan.order[:, None] >= plan.order)
    yield steps / np.sqrt(steps.sum(axis=1).max())
    for leg in range(3):
        yield np.diag(plan.leg == leg)


def test_patterns_beyond_the_list_are_brute_force_by_another_way() -> None:
    """Each pattern's covariance, at both sizes and for every σ."""
    found = assessed(("axis_gap", "stand_shift"), 5, True)
    white, noise = found.at.white, found.at.noise
    residual, columns = linear_model(found, ())
    stated = white.machine.gauge.noise_mm

    def log(root: Floats, scale: float = 1.0) -> float:
        wide = np.hstack((columns, root))
        grid = zip(noise.log_weight, scale * noise.sigma, strict=True)
        return float(np.logaddexp.reduce([w + dense(wide, sigma, residual) for w, sigma in grid]))

    expected = []
    for pattern in patterns(white.plan):
        each = [log(size * stated * (white.matrix @ pattern)) for size in PATTERN_SIZES]
        expected.append(np.logaddexp.reduce(each) - np.log(len(each)))
    each = [log(np.zeros((len(white), 0)), scale) for scale in NOISIER]
    expected.append(np.logaddexp.reduce(each) - np.log(len(each)))
    general = [pattern for pattern in found.unlisted if "each by itself" not in pattern.what]
    got = [pattern.log_evidence for pattern in general]
    assert got == pytest.approx(expected, abs=2e-3, rel=1e-6)
    assert np.ptp(expected) > 10.0
    assert sum(np.exp(pattern.log_prior) for pattern in general) == pytest.approx(UNLISTED)


@pytest.mark.parametrize("cause", ["axis_gap", "axis_squareness", "bar_skew", "backlash"])
def test_refined_evidence_against_weighted_samples_of_the_full_model(cause: str) -> None:
    """∫ likelihood · prior over offsets and parameters, by importance sampling.

    8,000 samples from the Gaussian around the fit, a little wider; their own standard error
    is computed and stays below 0.03. The fit's evidence is exact for a linear model; backlash
    also has the three widths' bounds, which it treats one by one.
    """
    found = assessed((cause,), 3, True)
    fit, white, noise = found.fit((cause,)), found.at.white, found.at.noise
    kind, rng = CAUSES[cause], np.random.default_rng(9)
    mean = np.concatenate((fit.offsets, fit.effects[0].theta))
    root = 1.15 * np.linalg.cholesky(_joint_covariance(fit, fit.effects))
    normal = rng.standard_normal((8_000, mean.size))
    samples = mean + normal @ root.T
    offsets, theta = samples[:, :3], samples[:, 3:]
    model = white.problem.model.extended([kind.at(theta)])
    readings = simulate(model, offsets, white.plan)
    square = ((white.data - readings @ white.matrix.T) ** 2).sum(axis=1)
    likelihood = np.logaddexp.reduce(
        noise.log_weight
        - 0.5 * square[:, None] / noise.sigma**2
        - len(white) * np.log(noise.sigma),
        axis=1,
    )
    stds = np.concatenate((np.full(3, OFFSET_MM), kind.prior_std(white.machine)))
    standard = np.hstack((offsets - found.at.offsets[0], theta)) / stds
    prior = np.logaddexp.reduce(
        [
            np.log(share)
            - 0.5 * (standard[:, :3] ** 2).sum(axis=1)
            - 0.5 * ((standard[:, 3:] / scale) ** 2).sum(axis=1)
            - np.log(stds).sum()
            - theta.shape[1] * np.log(scale)
            for scale, share in SCALES.items()
        ]
    )
    if kind.positive:
        inside = np.all(theta[:, : len(kind.names)] >= 0.0, axis=1)
        prior = np.where(inside, prior + len(kind.names) * np.log(2.0), -np.inf)
    proposal = -0.5 * (normal**2).sum(axis=1) - np.log(np.diag(root)).sum()
    logs = likelihood + prior - proposal
    weights = np.exp(logs - logs.max())
    sampled = logs.max() + np.log(weights.mean())
    error = weights.std() / weights.mean() / np.sqrt(len(weights))
    assert error < 0.03
    # Or one of its parameters acts alone.
    residual, columns = linear_model(found, (kind,))
    sampled = either(sampled, one_alone(noise, kind, columns, residual, 0))
    tolerance = 0.5 if kind.positive else 0.05
    assert fit.log_evidence == pytest.approx(sampled, abs=tolerance + 3.0 * error)


@pytest.mark.parametrize("exact", [True, False], ids=["exact", "real"])
@pytest.mark.parametrize(
    ("ids", "sized"),
    [
        (("axis_gap", "bar_skew"), (3, 6)),
        (("backlash", "stand_shift"), (6, 1)),
        (("axis_squareness", "gauge_slip"), (3, None)),
        (("bar_skew", "swapped_gauges"), (6, None)),
    ],
    ids=lambda value: "+".join(value) if isinstance(value[0], str) else "",
)
def test_each_effect_has_its_own_block_of_the_covariance(
    ids: Ids, sized: tuple[int | None, ...], exact: bool
) -> None:
    """Against the inverse of Jᵀ(σ² + CCᵀ)⁻¹J + 1/prior², J by finite differences of the model.

    C is what is uncertain of the data in addition to noise.
    """
    found = assessed(("axis_gap", "stand_shift"), 5, exact)
    fit, white = found.fit(ids), found.at.white
    assert tuple(effect.cause.id for effect in fit.effects) == ids
    model, free = white.problem.model, [e for e in fit.effects if e.covariance is not None]
    given = [e for e in fit.effects if e.covariance is None]
    sizes = [len(e.theta) if e.covariance is not None else None for e in fit.effects]
    assert sizes == list(sized)
    start = np.concatenate([fit.offsets, *(effect.theta for effect in free)])
    scale = found.scores[ids].scale
    prior = [np.full(3, OFFSET_MM)]
    for effect in free:
        blunder = max(BLUNDERS) if isinstance(effect.cause, PatternCause) else scale
        prior.append(blunder * effect.cause.prior_std(white.machine))
        if effect.cause.positive:
            # Of a normal distribution cut at zero.
            prior[-1][: len(effect.cause.names)] *= np.sqrt(1.0 - 2.0 / np.pi)

    def predicted(unknowns: Floats) -> Floats:
        parts = np.split(unknowns, np.cumsum([3, *(len(e.theta) for e in free)])[:-1])
        moved = [e.cause.at(part, e.place) for e, part in zip(free, parts[1:], strict=True)]
        readings = simulate(model.extended([*moved, *given]), parts[0], white.plan)
        return np.asarray(white.matrix @ readings)

    stds = np.concatenate(prior)
    steps = 1e-4 * np.minimum(stds, 0.1)
    jacobian = np.stack(
        [(predicted(start + d) - predicted(start - d)) / (2.0 * d.sum()) for d in np.diag(steps)],
        axis=1,
    )
    uncertain = linear_model(found, (), given)[1][:, 3:]
    spread = fit.sigma**2 * np.eye(len(white)) + uncertain @ uncertain.T
    expected = np.linalg.inv(
        jacobian.T @ np.linalg.solve(spread, jacobian) + np.diag(1.0 / stds**2)
    )
    scale = np.sqrt(np.diag(expected))
    error = (_joint_covariance(fit, free) - expected) / np.outer(scale, scale)
    assert np.abs(error).max() < 2e-3
    at = 3
    for effect in free:
        own = slice(at, at + len(effect.theta))
        at = own.stop
        assert effect.covariance is not None
        error = (effect.covariance - expected[own, own]) / np.outer(scale[own], scale[own])
        assert np.abs(error).max() < 2e-3
