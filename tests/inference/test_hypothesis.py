"""Explanations against numbers of others: how likely they are, what they estimate and leave out.

The forward model is that of `tests.truth`; evidence is integrated, sampled by dynesty, or of
matrices that are written out.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.files.input import read_input
from orthoglide_cal.inference.data import Whitened
from orthoglide_cal.inference.diagnose import Diagnosis
from orthoglide_cal.inference.evidence import Gaussian, NoiseGrid, Texture
from orthoglide_cal.inference.fit import Fit, leave_out, left_out
from orthoglide_cal.model.measured import DIFFERENCES, DataKind
from orthoglide_cal.model.model import Model, simulate
from orthoglide_cal.model.orthoglide import Orthoglide, double_posture
from orthoglide_cal.model.plan import Floats, Ints
from orthoglide_cal.model.readings import Series
from tests import truth
from tests.cli.program import refusals
from tests.inference.sessions import known
from tests.machines import NOMINAL, PROTOTYPE, SAMPLES
from tests.model.test_plan import groups
from tests.readings import readings_of
from tests.truth.evidence import Evidence

Ids = tuple[str, ...]


@cache
def drawn(hidden: Ids, gauge: truth.Gauge = truth.DIAL) -> tuple[Evidence, Diagnosis]:
    session = truth.make_session(3, truth.PROTOTYPE, gauge, hidden)
    return Evidence(session), Diagnosis.about(*known(session))


@pytest.mark.parametrize("line", refusals(Path(__file__).with_name("explained.txt")))
def test_evidence_is_that_of_another_forward_model(line: str) -> None:
    """Odds to 5 %: σ is integrated here and summed there, and what is far below it is left out."""
    ids, hidden = (tuple(part.split()) for part in line.split("|"))
    other, found = drawn(hidden)
    expected = other.integrated(list(other.cases(ids)))
    assert found.hypotheses[ids].log_evidence == pytest.approx(expected, abs=0.05)
    assert found.fit_of(ids).log_evidence == pytest.approx(expected, abs=0.05)


def test_widths_of_lost_motion_are_not_negative() -> None:
    """All three are clearly positive here, which makes it 8 times as likely."""
    other, found = drawn(("backlash",), truth.MICRON)
    cases = list(other.cases(("backlash",)))
    expected = other.integrated(cases)
    free = other.integrated([replace(case, positive=0) for case in cases])
    assert expected - free == pytest.approx(np.log(8.0), abs=0.1)
    assert found.fit_of(("backlash",)).log_evidence == pytest.approx(expected, abs=0.1)


def test_evidence_of_what_is_not_listed() -> None:
    """What returns with the posture, or scatters more: to 20 % of the odds.

    What is uncertain of every session is taken as large as the noise, which costs that much.
    """
    other, found = drawn(())
    for label, cases in other.patterns().items():
        log = found.patterned[label].log_evidence
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
    assert found.fit_of(ids).log_evidence == pytest.approx(expected, abs=5.0 * error + 0.05)


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
    fit = found.fit_of(ids)
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


@pytest.mark.parametrize(("known", "width"), [(9, 4), (4, 4), (4, 9), (4, 12)])
def test_densities_are_those_of_the_dense_covariance(known: int, width: int) -> None:
    """Evidence, and how patterns weigh and match, with every covariance written out.

    Fewer, as many and more columns than data, one twice another, sizes far apart. Along some axes
    the shared shape has variances of their own, in all other directions the same one.
    """
    rng = np.random.default_rng(8)
    columns, residual = rng.normal(size=(2, 9, width)), rng.normal(scale=0.02, size=9)
    columns[:, :, 1] = 2.0 * columns[:, :, 0]
    patterns = rng.normal(size=(9, 3))
    sizes = 10.0 ** rng.uniform(-3.0, 1.0, (2, width))
    shares = np.log([0.4, 0.6])
    axes = np.linalg.qr(rng.normal(size=(9, known)))[0]
    spectrum, rest = rng.uniform(0.0, 0.001, size=known), 2e-4
    shape = rest * np.eye(9) + axes * (spectrum - rest) @ axes.T
    grid = NoiseGrid.around(0.01, Texture(axes, spectrum, rest, assumed=False))
    density = Gaussian(columns, sizes, grid, shares)
    log, overlap = density.by_noise(residual), density.overlap(patterns, residual)
    power, match = density.against(overlap, density.overlap(residual[:, None], residual))
    each = density.log_density(patterns)
    assert log.shape == (2, 2, grid.sigma.size)
    for b, s, g in np.ndindex(log.shape):
        scaled = columns[b] * sizes[s]
        own = grid.sigma[g] ** 2 * np.eye(9) + grid.scale_factor[g] ** 2 * shape
        inverse = np.linalg.inv(own + scaled @ scaled.T)
        log_det = -np.linalg.slogdet(inverse)[1]
        weight = shares[s] + grid.log_weight[g]
        wanted = weight - 0.5 * (residual @ inverse @ residual + log_det)
        power_of = np.diag(patterns.T @ inverse @ patterns)
        assert each[b, s, g] == pytest.approx(weight - 0.5 * (power_of + log_det), rel=1e-6)
        assert log[b, s, g] == pytest.approx(wanted, rel=1e-9)
        assert power[b, s, g] == pytest.approx(power_of, rel=1e-7)
        assert match[b, s, g] == pytest.approx(patterns.T @ inverse @ residual, rel=1e-7)


def sample(name: str) -> Whitened:
    return Whitened.of(read_input(str(SAMPLES / name)).measured, NOMINAL)


@pytest.mark.parametrize(
    "name", ["experiment2.csv", "double_posture_session.csv", "single_posture_session.csv"]
)
def test_noise_of_the_whitened_data_is_white(name: str) -> None:
    white = sample(name)
    rows = np.eye(len(white)) @ white.matrix
    assert rows @ rows.T == pytest.approx(np.eye(len(white)), abs=1e-12)
    assert np.abs(white.matrix @ white.plan.zeros).max() < 1e-12
    residual = np.linspace(-0.3, 0.7, len(white))
    assert white.rms(residual) == pytest.approx(np.sqrt(np.mean(white.plain(residual) ** 2)))


def test_six_differences_pass_the_isotropic_posture() -> None:
    """max − min alone would have the carriages go straight from limit to limit."""
    white = sample("experiment2.csv")
    assert set(white.plan.displacement.tolist()) == {0.0, 60.0, -100.0}
    readings = simulate(NOMINAL, np.array([0.3, -0.5, 0.2]), white.plan)
    differences = white.root @ white.matrix @ readings

    def at(series: Series, displacement: float) -> float:
        (value,) = readings[white.plan.of(series) & (white.plan.displacement == displacement)]
        return float(value)

    expected = [
        at(each.series, 60.0) - at(each.series, -100.0) for each in DIFFERENCES[DataKind.SIX]
    ]
    assert white.in_file.tolist() == list(range(6))
    assert differences == pytest.approx(expected, abs=1e-12)
    assert white.plain(white.matrix @ readings) == pytest.approx(expected, abs=1e-12)


def test_defaults_are_scaled_like_what_is_given() -> None:
    silent = Model(PROTOTYPE.changed(tolerances={"misread": 0.2}))
    plan = double_posture(PROTOTYPE)
    readings = replace(readings_of(PROTOTYPE, plan, np.linspace(0.0, 1.0, 60)), timed=False)
    white = Whitened.of(readings, silent)
    doubled = white.scaled(2.0, CAUSES.values()).machine
    for id, cause in CAUSES.items():
        factor = 3.0 if cause.unit == "mm/h" else 1.0
        assert cause.size(white.machine) == factor * cause.size(silent.machine), id
        assert (cause.size(white.machine) > 0.0) == (Orthoglide in cause.sizes), id
        assert cause.size(doubled) == 2.0 * cause.size(white.machine), id


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def refits(white: Whitened, fit: Fit, cells: list[Ints]) -> Iterator[tuple[Floats, Floats]]:
    """Each cell predicted by a fit to the other readings: (errors, their covariance).

    Readings y = Z z + C u + e: gauge zeros z without a prior, offsets and parameters u with the
    one that the fit had. Solved in full for each cell, with the zeros as unknowns.
    """
    n, zeros = len(white.plan), white.plan.zeros
    design = np.hstack((zeros, white.matrix.T @ fit.columns)) / fit.sigma
    values = white.matrix.T @ fit.linear / fit.sigma
    penalty = np.diag(np.concatenate((np.zeros(zeros.shape[1]), 1.0 / fit.sizes**2)))
    for cell in cells:
        kept = np.setdiff1d(np.arange(n), cell)
        spread = np.linalg.inv(design[kept].T @ design[kept] + penalty)
        found = spread @ design[kept].T @ values[kept]
        error = values[cell] - design[cell] @ found
        covariance = np.eye(len(cell)) + design[cell] @ spread @ design[cell].T
        yield fit.sigma * error, fit.sigma**2 * covariance


@pytest.mark.parametrize(
    ("hidden", "seed", "rel"),
    [("axis_squareness", 4, 1e-6), ("stand_shift", 4, 1e-6), ("misread", 2, 1e-4)],
)
def test_leaving_a_cell_out_is_refitting_without_it(hidden: str, seed: int, rel: float) -> None:
    """A wrong reading is not held against the model: it stays where its size takes it up."""
    readings, model = known(truth.make_session(seed, truth.PROTOTYPE, truth.MICRON, (hidden,)))
    white = Whitened.of(readings, model)
    found = Diagnosis.about(readings, model)
    accepted = found.fit_of((hidden,))
    wrong = accepted.wrong_readings
    assert len(wrong) == (hidden == "misread")
    # Readings of each (leg, direction, posture).
    cells = [np.setdiff1d(cell, wrong) for cell in groups(white.plan.cells)]
    assert len(cells) == 18
    for fit in (found.fit_of(()), accepted):
        errors, scaled = [], []
        for error, covariance in refits(white, fit, cells):
            errors.append(error)
            scaled.append(np.linalg.solve(np.linalg.cholesky(covariance), error))
        held_out = leave_out(fit, left_out(white, accepted.wrong_readings))[2]
        assert held_out.rms_mm == pytest.approx(rms(np.concatenate(errors)), rel=rel)
        assert held_out.ratio == pytest.approx(rms(np.concatenate(scaled)), rel=rel)
