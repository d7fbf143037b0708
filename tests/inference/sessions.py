"""Sessions of the independent truth as the program reads them."""

from dataclasses import replace
from functools import cache

import numpy as np

from orthoglide_cal.estimation.gaussian import condition
from orthoglide_cal.files.input import Input, read_input
from orthoglide_cal.files.machine_file import stored_machine
from orthoglide_cal.files.text import document_from_bytes
from orthoglide_cal.inference.data import Whitened, as_read, unit_of
from orthoglide_cal.inference.diagnose import Diagnosis
from orthoglide_cal.inference.fit import Fit
from orthoglide_cal.model.measured import DIFFERENCES, DataKind, Differences, Readings
from orthoglide_cal.model.model import Model, differentiate
from orthoglide_cal.model.orthoglide import reduction
from tests import truth
from tests.truth.delta import DeltaSession, delta_csv, delta_yaml

OPTIMAL = 0.5
"""The fit takes one or two Gauss–Newton steps, which leave up to a quarter of a standard
deviation."""


def texts_of(session: truth.Session | DeltaSession) -> tuple[str, str]:
    if isinstance(session, DeltaSession):
        return delta_yaml(session.machine), delta_csv(session)
    return truth.machine_yaml(session.machine, session.gauge), truth.readings_csv(session)


@cache
def model_from(text: str) -> Model:
    return stored_machine(text, "machine.yaml").model


def model_of(hidden: truth.Machine, gauge: truth.Gauge) -> Model:
    """The machine file that states the truth's machine, gauge and tolerances."""
    return model_from(truth.machine_yaml(hidden, gauge))


def read(text: str, model: Model) -> Readings:
    return read_input(document_from_bytes(text.encode(), "session.csv"), model).measured


def given(session: truth.Session | DeltaSession) -> Input:
    """Record and machine, through the texts of their files."""
    machine, record = texts_of(session)
    return read_input(document_from_bytes(record.encode(), "session.csv"), model_from(machine))


def known(session: truth.Session) -> tuple[Readings, Model]:
    read = given(session)
    return read.measured, read.model


def readings_of(session: truth.Session) -> Readings:
    return known(session)[0]


def ids(found: Diagnosis) -> list[str]:
    """What is named, likeliest first."""
    return [cause.id for cause in found.causes]


def changed(diagnosis: Diagnosis, **worked_out: object) -> Diagnosis:
    """The same with other values of what it works out once."""
    other = replace(diagnosis)
    vars(other).update(worked_out)
    return other


def reduced(kind: DataKind, readings: Readings, model: Model) -> Differences:
    """The differences that the paper prints of such readings."""
    which = DIFFERENCES[kind]
    matrix = reduction(kind, which, model.machine, readings.plan)
    return Differences(kind, which, matrix @ readings.value, readings.source)


def step_left(fit: Fit, white: Whitened) -> float:
    """The largest step that Gauss–Newton would still take in an offset or a parameter, with the
    priors of the fit [standard deviations]; counts of turns and faults of the record are fixed."""
    fixed = [effect for effect in fit.effects if effect.covariance is None]
    sized = [effect for effect in fit.effects if effect.covariance is not None]
    theta = np.concatenate([0.0 * fit.offsets, *(effect.theta for effect in sized)])
    model, plan = white.problem.model.extended(fixed), as_read(white.plan, fixed)
    readings, jacobians = differentiate(model, fit.offsets, plan, sized)
    unit = unit_of(fixed)
    columns = np.hstack([white.matrix @ jacobians, fit.columns[:, theta.size :] / unit])
    linear = white.data + white.matrix @ (jacobians @ theta - readings) - columns @ fit.centre
    # Weighed as the fit was: by the stated noise, however large it turned out to be.
    found, _ = condition(columns, linear, fit.sizes, white.machine.instrument.noise_mm / unit)
    step = (fit.centre + found)[: theta.size] - theta
    return float(np.max(np.abs(step) / np.sqrt(np.diag(fit.covariance)[: theta.size])))
