"""Clerical faults of a whole table, made in the text of files of the independent truth."""

from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.inference.data import OFFSETS_MM, Candidates, Whitened
from orthoglide_cal.inference.diagnose import Diagnosis, diagnose
from orthoglide_cal.inference.result import Verdict
from orthoglide_cal.model.measured import DataKind, Readings
from orthoglide_cal.model.model import Place
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.results.making import release
from tests import truth
from tests.inference.sessions import OPTIMAL, known, model_of, read, reduced, step_left
from tests.sentences import sentences

both_gauges = pytest.mark.parametrize("gauge", [truth.DIAL, truth.MICRON], ids=lambda g: g.name)
SEED = 1
# Units: what one mm is written as, and the decimals that are written.
UNITS = {
    "inches written as mm": (1.0 / 25.4, 5),
    "mm written as inches": (25.4, 6),
    "metres written as mm": (1e-3, 6),
}


def dense(columns: Floats, sigma: float, residuals: Floats) -> Floats:
    """ln N(r; 0, σ² I + B Bᵀ) without −k/2 ln 2π, of residuals (k,) or (k, p)."""
    covariance = sigma**2 * np.eye(len(residuals)) + columns @ columns.T
    square = (residuals * np.linalg.solve(covariance, residuals)).sum(axis=0)
    return np.asarray(-0.5 * (square + np.linalg.slogdet(covariance)[1]))


def exchanged(readings: Readings, session: truth.Session) -> Readings:
    """The file with the headings leg and direction exchanged."""
    header, *rows = truth.readings_csv(session).splitlines()
    assert ",leg,direction," in header
    swapped = header.replace(",leg,direction,", ",direction,leg,")
    return read("\n".join((swapped, *rows)) + "\n", model_of(session.machine, session.gauge))


def off(found: Diagnosis, session: truth.Session) -> np.ndarray:
    """Errors of the offsets in standard deviations."""
    return np.asarray(np.abs(found.offsets_mm - session.offsets) / found.std_mm)


@both_gauges
@pytest.mark.parametrize("machine", [truth.PROTOTYPE, truth.LARGE], ids=lambda m: m.name)
def test_exchanged_columns_are_named(machine: truth.Machine, gauge: truth.Gauge) -> None:
    """Before, these were distances between axes, to be shimmed; 12 offsets within 4.5 u."""
    session = truth.make_session(SEED, machine, gauge)
    readings, model = known(session)
    found = diagnose(exchanged(readings, session), model)
    assert [cause.id for cause in found.causes] == ["exchanged_columns"]
    assert "headings leg and direction" in sentences([found.causes[0].remedy])[0]
    assert np.all(off(found, session) < 4.5)
    assert found.offsets_mm == pytest.approx(solve(readings, model).offsets_mm, abs=1e-4)
    assert found.causes[0].heldout_after_mm < 1.5 * truth.expected_heldout(session)
    assert step_left(found.left_open[0][1], Whitened.of(found.measured, model)) < OPTIMAL


@pytest.mark.parametrize("kind", [DataKind.SIX, DataKind.TWELVE])
def test_differences_with_leg_and_direction_exchanged(kind: DataKind) -> None:
    """dx_y was written for dy_x: six numbers leave three beyond the offsets."""
    session = truth.make_session(2, truth.PROTOTYPE, truth.MICRON, offset_sd=1.5)
    readings, model = known(session)
    found = diagnose(reduced(kind, exchanged(readings, session), model), model)
    assert found.verdict in (Verdict.NAMED, Verdict.AMBIGUOUS)
    assert "exchanged_columns" in {cause.id for cause in found.causes} | set(found.ambiguous_with)


# --- units ------------------------------------------------------------------------------------


@both_gauges
@pytest.mark.parametrize("mistake", UNITS)
def test_a_wrong_unit_is_named(mistake: str, gauge: truth.Gauge) -> None:
    """With the offsets in mm; what is explained stays in the unit of the file."""
    per_mm, decimals = UNITS[mistake]
    session = truth.make_session(SEED, truth.PROTOTYPE, gauge)
    readings, model = known(session)
    wrong = replace(readings, value=np.round(readings.value * per_mm, decimals))
    found = diagnose(wrong, model)
    assert [(cause.id, cause.where) for cause in found.causes] == [("wrong_unit", mistake)]
    assert np.all(off(found, session) < 4.5)
    assert step_left(found.left_open[0][1], Whitened.of(found.measured, model)) < OPTIMAL
    left = (found.measured.value - found.explained_mm) / per_mm
    assert np.sqrt(np.mean(left**2)) < 1.3 * gauge.sigma
    # In mm without the cause, too; the offsets are then so wrong that more may be left.
    (cause,) = found.causes
    assert cause.heldout_after_mm == pytest.approx(gauge.sigma, rel=0.4)
    assert 0.9 < cause.rms_before_mm / cause.rms_after_mm < 10.0
    assert 0.9 < cause.heldout_before_mm / cause.heldout_after_mm < 10.0


def test_noise_is_no_unit() -> None:
    """Readings that scatter as in inches, but lie on the divisions of a gauge in mm."""
    gauge = truth.DIAL
    readings, model = known(truth.make_session(SEED, truth.PROTOTYPE, gauge))
    wild = np.random.default_rng(SEED).normal(0.0, 25.4 * gauge.noise, len(readings))
    shown = np.rint((readings.value + wild) / gauge.resolution) * gauge.resolution
    found = diagnose(replace(readings, value=np.round(shown, gauge.decimals)), model)
    assert found.verdict is Verdict.UNEXPLAINED


def test_a_misread_number_beside_it_does_not_release_the_offsets() -> None:
    readings, model = known(truth.make_session(2, truth.PROTOTYPE, truth.DIAL, ("misread",)))
    wrong = replace(readings, value=np.round(readings.value / 25.4, 5))
    decision = release(solve(wrong, model), diagnose(wrong, model))
    assert not decision.usable
    assert "inches written as mm" in sentences(decision.reasons)[0]


def test_evidence_of_a_unit_is_the_density_of_what_was_written() -> None:
    """Of recorded numbers whose noise is the unit's, and offsets of any size in any unit."""
    session = truth.make_session(4, truth.PROTOTYPE, truth.DIAL, offset_sd=0.05)
    readings, model = known(session)
    per_mm = 1.0 / 25.4
    found = Diagnosis.about(replace(readings, value=readings.value * per_mm), model)
    sets = Candidates.of(model, ordered=True).log_prior
    assert sets[("wrong_unit",)] == pytest.approx(sets[("misread",)] + np.log(0.1))
    at, placed = found.at, found.at.extras["wrong_unit"]
    number = placed.first + placed.tried.index(Place((0,)))
    wide, residual = at.jacobian * OFFSETS_MM, at.residuals[number] * per_mm
    parts = [
        weight + dense(wide, per_mm * sigma, residual)
        for weight, sigma in zip(at.noise.log_weight, at.noise.sigma, strict=True)
    ]
    expected = np.logaddexp.reduce(parts) - np.log(len(placed.log_weight))
    assert found.hypotheses[("wrong_unit",)].log_evidence == pytest.approx(expected, abs=0.01)


# --- the sign of a whole table, and other faults that nothing shows ---------------------------


def test_small_offsets_do_not_tell_the_sign_of_a_table() -> None:
    """It is as consistent as it was, and no wider: nobody could rule the other sign out."""
    readings, model = known(truth.make_session(SEED, truth.PROTOTYPE, truth.DIAL))
    right, wrong = (diagnose(replace(readings, value=s * readings.value), model)
                    for s in (1.0, -1.0))  # fmt: skip
    assert right.verdict == wrong.verdict == Verdict.CONSISTENT
    assert wrong.offsets_mm == pytest.approx(-right.offsets_mm, abs=0.01)
    assert wrong.std_mm == pytest.approx(right.std_mm, rel=0.3)


def test_large_offsets_do() -> None:
    session = truth.make_session(SEED, truth.PROTOTYPE, truth.DIAL, offset_sd=8.0)
    readings, model = known(session)
    found = diagnose(replace(readings, value=-readings.value), model)
    assert [(c.id, c.where) for c in found.causes] == [("sign_flip", "all readings")]
    assert np.all(off(found, session) < 4.5)


@pytest.mark.parametrize("offset_sd", [0.0, 0.5, 2.0, 5.0])
def test_healthy_sessions_are_not_widened_by_what_nothing_shows(offset_sd: float) -> None:
    gauge = truth.DIAL if offset_sd in (0.0, 2.0) else truth.MICRON
    session = truth.make_session(0, truth.LARGE, gauge, offset_sd=offset_sd)
    found = diagnose(*known(session))
    assert found.verdict is Verdict.CONSISTENT
    left_open = [id for one in found.explanations if one.parameters for id in one.ids]
    assert all(CAUSES[id].names for id in (*found.not_excluded, *left_open))


def test_offsets_of_200_mm_are_still_judged() -> None:
    """The other sign is out of reach of this machine: it is left out, nothing fails."""
    readings, model = known(truth.make_session(1, truth.PROTOTYPE, truth.DIAL, offset_sd=60.0))
    assert diagnose(readings, model).verdict is Verdict.CONSISTENT


@both_gauges
def test_two_legs_written_for_each_other_are_the_third_ones_gauges(gauge: truth.Gauge) -> None:
    """No reading tells these two apart; the advice names both."""
    session = truth.make_session(SEED, truth.PROTOTYPE, gauge)
    model = model_of(session.machine, session.gauge)
    header, *rows = truth.readings_csv(session).splitlines()
    other = {"x": "y", "y": "x", "z": "z"}
    cells = [row.split(",") for row in rows]
    for cell in cells:
        if cell[3] != "z":
            cell[3], cell[4] = other[cell[3]], other[cell[4]]
    text = "\n".join((header, *(",".join(cell) for cell in cells))) + "\n"
    found = diagnose(read(text, model), model)
    assert ("swapped_gauges", "leg z") in [(c.id, c.where) for c in found.causes]
    assert "the other two legs are exchanged" in sentences([found.causes[0].remedy])[0]
