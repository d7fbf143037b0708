"""Evidence: closed forms against dense covariances, quadrature and weighted samples."""

from functools import cache

import numpy as np
import pytest

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import CAUSES, Cause, PatternCause, RelabelCause
from orthoglide_cal.diagnosis.assess import Assessment, assess
from orthoglide_cal.diagnosis.evidence import Gaussian, NoiseGrid
from orthoglide_cal.diagnosis.explanations import Names
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.diagnosis.screen import BLUNDER_SCALES, OFFSETS_MM
from orthoglide_cal.diagnosis.sparse import ALL
from orthoglide_cal.effects import Commanded
from orthoglide_cal.estimation import solve
from orthoglide_cal.simulation import simulate
from tests import truth
from tests.diagnosis.sessions import known

GRID = NoiseGrid.around(0.004)


def dense(columns: Floats, sigma: float, residual: Floats) -> float:
    """ln N(r; 0, σ² I + B Bᵀ) without −k/2 ln 2π."""
    covariance = sigma**2 * np.eye(len(residual)) + columns @ columns.T
    square = residual @ np.linalg.solve(covariance, residual)
    return float(-0.5 * (square + np.linalg.slogdet(covariance)[1]))


@pytest.mark.parametrize("shape", [(9, 4), (6, 6), (5, 11)], ids=str)
def test_densities_are_those_of_the_dense_covariance(shape: tuple[int, int]) -> None:
    """Fewer, as many and more columns than data, one column twice another, sizes far apart."""
    rng = np.random.default_rng(1)
    columns = rng.normal(size=shape) * 10.0 ** rng.uniform(-3.0, 1.0, shape[1])
    columns[:, 1] = 2.0 * columns[:, 0]
    vectors, residual = rng.normal(0.0, 0.01, (shape[0], 3)), rng.normal(0.0, 0.02, shape[0])
    density = Gaussian(columns, GRID)
    for g, sigma in enumerate(GRID.sigma):
        inverse = np.linalg.inv(sigma**2 * np.eye(shape[0]) + columns @ columns.T)
        quadratic = np.einsum("kq,kl,lq->q", vectors, inverse, vectors)
        product = vectors.T @ inverse @ residual
        power, match = density.against(vectors, residual)
        assert power[g] == pytest.approx(quadratic, rel=1e-6)
        assert match[g] == pytest.approx(product, rel=1e-5)
        logs = [dense(columns, float(sigma), vector) for vector in vectors.T]
        assert density.log_density(vectors)[g] == pytest.approx(logs, rel=1e-6, abs=1e-5)


@pytest.mark.parametrize("shape", [(9, 4), (5, 11)], ids=str)
def test_many_at_once_and_padded_with_zeros_are_as_each_alone(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(3)
    wide = rng.normal(size=(3, *shape))
    wide[0, :, 2:] = 0.0
    vectors, residual = rng.normal(size=(shape[0], 2)), rng.normal(size=shape[0])
    together = Gaussian(wide, GRID)
    power, match = together.against(vectors, residual)
    for number, columns in enumerate([wide[0, :, :2], wide[1], wide[2]]):
        alone = Gaussian(columns, GRID)
        density = together.log_density(vectors)[number]
        assert density == pytest.approx(alone.log_density(vectors), rel=1e-9)
        assert power[number] == pytest.approx(alone.against(vectors, residual)[0], rel=1e-6)
        assert match[number] == pytest.approx(alone.against(vectors, residual)[1], rel=1e-6)


def test_one_parameter_integrated_by_hand() -> None:
    """∫ N(r; c t, σ²) N(t; 0, 1) dt on a fine grid of t."""
    rng = np.random.default_rng(2)
    column, residual = rng.normal(0.0, 0.01, 5), rng.normal(0.0, 0.01, 5)
    density = Gaussian(column[:, None], GRID).log_density(residual[:, None])[:, 0]
    t = np.linspace(-12.0, 12.0, 48001)
    for sigma, log in zip(GRID.sigma, density, strict=True):
        square = ((residual[:, None] - column[:, None] * t) ** 2).sum(axis=0)
        inside = np.exp(-0.5 * square / sigma**2 - 0.5 * t**2) / np.sqrt(2.0 * np.pi)
        byhand = np.log(np.trapezoid(inside, t)) - len(residual) * np.log(sigma)
        assert log == pytest.approx(byhand, abs=1e-9)


def test_the_noise_is_weighed_around_what_is_stated() -> None:
    grid = NoiseGrid.around(0.0067)
    assert np.exp(grid.log_weight).sum() == pytest.approx(1.0)
    assert grid.sigma.min() < 0.6 * 0.0067
    assert grid.sigma.max() > 1.5 * 0.0067
    mean = np.exp(grid.log_weight) @ grid.sigma
    assert mean == pytest.approx(0.0067, rel=0.05)


@cache
def assessed(hidden: tuple[str, ...], seed: int) -> Assessment:
    readings, machine = known(truth.make_session(seed, truth.PROTOTYPE, truth.DIAL, hidden))
    return assess(Frame.of(readings, machine))


def linear_model(found: Assessment, base: tuple[Cause, ...]) -> tuple[Floats, Floats]:
    """Residual of the offsets-only fit and B of the base, by finite differences of simulate."""
    frame = found.frame
    offsets = frame.problem
    plan, machine = frame.plan, frame.machine
    start = found.catalogue.offsets[""]
    assert offsets.remaining_step(frame.data, start) < 1e-9
    step = 1e-4
    columns = [
        (simulate(machine, start + d, plan) - simulate(machine, start - d, plan))
        / (2.0 * step)
        * OFFSETS_MM
        for d in step * np.eye(3)
    ]
    for cause in base:
        size = len(cause.names) + len(cause.nuisance)
        for k, std in enumerate(cause.prior_std(machine)):
            d = step * cause.scale * np.eye(size)[k]
            up = simulate(machine, start, plan, [cause.at(d)])
            down = simulate(machine, start, plan, [cause.at(-d)])
            columns.append((up - down) / (2.0 * step * cause.scale) * std)
    residual = frame.data - frame.matrix @ simulate(machine, start, plan)
    return residual, frame.matrix @ np.stack(columns, axis=1)


def one_alone(noise: NoiseGrid, cause: Cause, columns: Floats, residual: Floats) -> float:
    """Evidence of one parameter acting alone, whichever it is; columns: offsets, then the cause."""
    ends = 3, 3 + len(cause.names)
    always = np.hstack((columns[:, : ends[0]], columns[:, ends[1] :]))
    each = []
    for one in columns[:, ends[0] : ends[1]].T:
        both = np.column_stack((always, one))
        logs = [dense(both, sigma, residual) for sigma in noise.sigma.tolist()]
        each.append(np.logaddexp.reduce(noise.log_weight + logs))
    return float(np.logaddexp.reduce(each) - np.log(len(each)))


def by_brute_force(found: Assessment, key: Names) -> float:
    """Evidence of a set, every σ, place and size one by one with a dense covariance."""
    frame, noise, machine = found.frame, found.noise, found.frame.machine
    extra = next((CAUSES[i] for i in key if len(CAUSES[i].places(frame.plan, machine)) > 1), None)
    base = tuple(CAUSES[i] for i in key if extra is None or i != extra.id)
    residual, columns = linear_model(found, base)
    parts = []
    for weight, sigma in zip(noise.log_weight, noise.sigma.tolist(), strict=True):
        covariance = sigma**2 * np.eye(len(frame)) + columns @ columns.T
        inverse, log_det = np.linalg.inv(covariance), np.linalg.slogdet(covariance)[1]
        if extra is None:
            parts.append(weight - 0.5 * (residual @ inverse @ residual + log_det))
            continue
        places = extra.places(frame.plan, machine)
        share = weight - np.log(len(places))
        for where in places:
            if isinstance(extra, RelabelCause):
                fitted = found.catalogue.residuals[extra.id][:, places.index(where)]
                parts.append(share - 0.5 * (fitted @ inverse @ fitted + log_det))
                continue
            assert isinstance(extra, PatternCause)
            commanded = Commanded(machine, frame.plan)
            acting = extra.at(np.ones(1), where)
            pattern = acting.contact(np.zeros(len(frame.plan)), np.zeros(1), commanded)
            pattern = frame.matrix @ acting.record(pattern, commanded)
            if extra.id == "gauge_slip":
                for turns, chance in CAUSES["gauge_slip"].counts.items():
                    left = residual - turns * pattern
                    square = left @ inverse @ left
                    parts.append(share + np.log(chance) - 0.5 * (square + log_det))
                continue
            for scale in BLUNDER_SCALES:
                size = scale * machine.tolerances[extra.id]
                wider = covariance + size**2 * np.outer(pattern, pattern)
                square = residual @ np.linalg.solve(wider, residual)
                log = -0.5 * (square + np.linalg.slogdet(wider)[1])
                parts.append(share - np.log(len(BLUNDER_SCALES)) + log)
    together = float(np.logaddexp.reduce(parts))
    if not base:
        return together
    if extra is not None or len(base) > 1:
        return together + float(np.log(ALL))
    single = one_alone(noise, base[0], columns, residual)
    return float(np.logaddexp(np.log(ALL) + together, np.log(1.0 - ALL) + single))


@pytest.mark.parametrize(
    "key",
    [
        (),
        ("axis_gap",),
        ("backlash",),
        ("gauge_drift",),
        ("gauge_slip",),
        ("sign_flip",),
        ("axis_squareness", "bar_skew"),
        ("axis_gap", "stand_shift"),
        ("encoder_scale", "swapped_gauges"),
    ],
    ids="+".join,
)
def test_screening_is_brute_force_by_another_way(key: Names) -> None:
    """With all places, all sizes and all σ of the grid, the derivatives by finite differences."""
    found = assessed(("axis_gap", "stand_shift"), 5)
    score = found.scores[key].log_evidence
    assert score == pytest.approx(by_brute_force(found, key), abs=2e-3, rel=1e-6)


def test_the_places_found_are_those_of_the_truth() -> None:
    session = truth.make_session(5, truth.PROTOTYPE, truth.DIAL, ("axis_gap", "stand_shift"))
    found = assessed(("axis_gap", "stand_shift"), 5)
    extra = found.scores["axis_gap", "stand_shift"].extra
    assert extra is not None
    hidden = next(effect for effect in session.effects if effect.id == "stand_shift")
    assert extra.where.index == (hidden.row,)


@pytest.mark.parametrize("cause", ["axis_gap", "axis_squareness", "bar_skew", "backlash"])
def test_refined_evidence_against_weighted_samples_of_the_full_model(cause: str) -> None:
    """∫ likelihood · prior over offsets and parameters, by importance sampling.

    8,000 samples from the Gaussian around the fit, a little wider; their own standard error
    is computed and stays below 0.03. The fit's evidence is exact for a linear model; backlash
    also has the three widths' bounds, which it treats one by one.
    """
    found = assessed((cause,), 3)
    fit, frame, noise = found.fit((cause,)), found.frame, found.noise
    kind, rng = CAUSES[cause], np.random.default_rng(9)
    mean = np.concatenate((fit.offsets, fit.acting[0].theta))
    root = 1.15 * np.linalg.cholesky(fit.covariance)
    normal = rng.standard_normal((8_000, mean.size))
    samples = mean + normal @ root.T
    offsets, theta = samples[:, :3], samples[:, 3:]
    readings = simulate(frame.machine, offsets, frame.plan, [kind.at(theta)])
    square = ((frame.data - readings @ frame.matrix.T) ** 2).sum(axis=1)
    likelihood = np.logaddexp.reduce(
        noise.log_weight
        - 0.5 * square[:, None] / noise.sigma**2
        - len(frame) * np.log(noise.sigma),
        axis=1,
    )
    start = found.catalogue.offsets[""]
    stds = np.concatenate((np.full(3, OFFSETS_MM), kind.prior_std(frame.machine)))
    standard = np.hstack((offsets - start, theta)) / stds
    prior = -0.5 * (standard**2).sum(axis=1) - np.log(stds).sum()
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
    linear = found.catalogue.linear[cause] * kind.prior_std(frame.machine)
    columns = np.hstack((found.catalogue.slope * OFFSETS_MM, linear))
    single = one_alone(noise, kind, columns, found.catalogue.residuals[""])
    sampled = np.logaddexp(np.log(ALL) + sampled, np.log(1.0 - ALL) + single)
    tolerance = 0.5 if kind.positive else 0.05
    assert fit.log_evidence == pytest.approx(sampled, abs=tolerance + 3.0 * error)


def test_the_offsets_only_fit_is_that_of_solve() -> None:
    """The prior on offsets (10 mm) moves them by less than a nanometre's fraction of σ."""
    readings, machine = known(truth.make_session(3, truth.LARGE, truth.MICRON))
    found = assess(Frame.of(readings, machine))
    solution = solve(readings, machine)
    assert found.fit(()).offsets == pytest.approx(solution.offsets_mm, abs=1e-6)
