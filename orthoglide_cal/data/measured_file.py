"""What was measured, from any file that a command takes; its kind is recognised by content."""

from __future__ import annotations

import re
from pathlib import PurePath

from orthoglide_cal.data.differences_table import DIFFERENCE_COLUMNS, differences_from_table
from orthoglide_cal.data.document import Document, read_document
from orthoglide_cal.data.machine_file import default_machine
from orthoglide_cal.data.reading_row import READING_COLUMNS, TEXT_COLUMNS
from orthoglide_cal.data.readings_table import readings_from_table
from orthoglide_cal.data.session_file import readings_from_tree
from orthoglide_cal.data.table import read_table
from orthoglide_cal.data.yaml_tree import load_tree
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Measured

_CODED = tuple({*DIFFERENCE_COLUMNS, *READING_COLUMNS} - set(TEXT_COLUMNS))
_YAML = re.compile(r"""(---|%YAML|\{|\[|-\s|["']?[A-Za-z_][A-Za-z_0-9 ]*["']?\s*:(\s|$))""")


def read_measured(path: str, machine: Machine) -> Measured:
    """Readings or differences, from a CSV or a session file.

    Args:
        path: as the user gave it; "-" is standard input.
        machine: gives the joint limits that postures refer to; used for a session, too.

    Raises:
        InvalidFileError: everything that is wrong with its content, each with its place.
        InputError: not readable, too large, or not text.
    """
    return read_input(path, machine)[0]


def read_input(path: str, machine: Machine | None = None) -> tuple[Measured, Machine]:
    """As `read_measured`, with the machine to judge it by.

    Args:
        path: as the user gave it; "-" is standard input.
        machine: the one that the user names. None stands for the one embedded in a session, and
            for the prototype otherwise.
    """
    return input_from_document(read_document(path), machine)


def input_from_document(
    document: Document, machine: Machine | None = None
) -> tuple[Measured, Machine]:
    """As `read_input`, from text that has been read."""
    if is_yaml(document):
        return readings_from_tree(load_tree(document), machine)
    judge = machine or default_machine()
    table = read_table(document, _CODED)
    if "difference" in table.columns:
        return differences_from_table(table, judge), judge
    return readings_from_table(table, judge), judge


def is_yaml(document: Document) -> bool:
    """Whether the first line that says anything is YAML; the name decides what it leaves open."""
    if PurePath(document.path).suffix.lower() in (".yaml", ".yml", ".json"):
        return True
    for line in document.text.split("\n", 1000):
        if line.strip() and not line.lstrip().startswith("#"):
            return bool(_YAML.match(line))
    return False
