"""Sessions of the independent truth as the program reads them."""

from functools import cache

from orthoglide_cal.files.input import Input, read_input
from orthoglide_cal.files.machine_file import machine_from_text
from orthoglide_cal.files.text import document_from_bytes
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.model import Model
from tests import truth
from tests.truth.delta import DeltaSession, delta_csv, delta_yaml


@cache
def model_of(hidden: truth.Machine, gauge: truth.Gauge) -> Model:
    """The machine file that states the truth's machine, gauge and tolerances."""
    return machine_from_text(truth.machine_yaml(hidden, gauge), "machine.yaml")


def read(text: str, model: Model) -> Readings:
    document = document_from_bytes(text.encode(), "session.csv")
    measured = read_input(document, model).measured
    assert isinstance(measured, Readings)
    return measured


def readings_of(session: truth.Session) -> Readings:
    """The record, through the text of its file."""
    return read(truth.readings_csv(session), model_of(session.machine, session.gauge))


def given(session: DeltaSession) -> Input:
    """Touches of a printer and its machine, through the texts of their files."""
    model = machine_from_text(delta_yaml(session.machine), "machine.yaml")
    return read_input(document_from_bytes(delta_csv(session).encode(), "touches.csv"), model)


def known(session: truth.Session) -> tuple[Readings, Model]:
    """Record and model of a session."""
    return readings_of(session), model_of(session.machine, session.gauge)
