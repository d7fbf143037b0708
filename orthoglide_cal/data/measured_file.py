"""What was measured, from any file that a command takes; its kind is recognised by content."""

from __future__ import annotations

from orthoglide_cal.data.differences_table import DIFFERENCE_COLUMNS, differences_from_table
from orthoglide_cal.data.document import Document, read_document
from orthoglide_cal.data.reading_row import READING_COLUMNS, TEXT_COLUMNS
from orthoglide_cal.data.readings_table import readings_from_table
from orthoglide_cal.data.table import read_table
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Measured

_CODED = {*DIFFERENCE_COLUMNS, *READING_COLUMNS} - set(TEXT_COLUMNS)


def read_measured(path: str, machine: Machine) -> Measured:
    """Readings or differences, from a CSV or a session file.

    Args:
        path: as the user gave it; "-" is standard input.
        machine: gives the joint limits that postures refer to.

    Raises:
        InvalidFileError: everything that is wrong with its content, each with its place.
        InputError: not readable, too large, or not text.
    """
    return measured_from_document(read_document(path), machine)


def measured_from_document(document: Document, machine: Machine) -> Measured:
    """As `read_measured`, from text that has been read."""
    table = read_table(document, tuple(_CODED))
    if "difference" in table.columns:
        return differences_from_table(table, machine)
    return readings_from_table(table, machine)
