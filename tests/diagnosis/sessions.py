"""Sessions of the independent truth as the program reads them."""

from functools import cache

from orthoglide_cal.data.document import document_from_bytes
from orthoglide_cal.data.machine_file import machine_from_tree
from orthoglide_cal.data.measured_file import input_from_document
from orthoglide_cal.data.yaml_tree import load_tree
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Readings
from tests import truth


@cache
def machine_of(hidden: truth.Machine, gauge: truth.Gauge) -> Machine:
    """The machine file that states the truth's machine, gauge and tolerances."""
    text = truth.machine_yaml(hidden, gauge)
    return machine_from_tree(load_tree(document_from_bytes(text.encode(), "machine.yaml")))


def readings_of(session: truth.Session) -> Readings:
    """The record, through the text of its file."""
    document = document_from_bytes(truth.readings_csv(session).encode(), "session.csv")
    measured, _ = input_from_document(document, machine_of(session.machine, session.gauge))
    assert isinstance(measured, Readings)
    return measured


def known(session: truth.Session) -> tuple[Readings, Machine]:
    """Record and machine of a session."""
    return readings_of(session), machine_of(session.machine, session.gauge)
