"""Everything that can be said of a file before it is used."""

from __future__ import annotations

from dataclasses import dataclass

from orthoglide_cal.data.document import Document, UnreadableError, read_document
from orthoglide_cal.data.machine_file import machine_from_tree
from orthoglide_cal.data.machine_schema import MachineModel
from orthoglide_cal.data.measured_file import input_from_document, is_yaml
from orthoglide_cal.data.session_file import readings_from_tree
from orthoglide_cal.data.yaml_tree import load_tree
from orthoglide_cal.errors import InputError, InvalidFileError
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Source


@dataclass(frozen=True)
class Check:
    """What a check found.

    Attributes:
        source: the file; None if it was refused before its content was looked at.
        path: as the user gave it.
        kind: "readings", "session", "six", "twelve", "single" or "machine"; None if invalid.
        name: of the machine in a machine file, or of the machine that readings are judged by.
        count: number of readings or differences.
        problems: everything that is wrong; empty for a valid file.
        remarks: what the user should know although nothing is wrong.
    """

    path: str
    source: Source | None
    kind: str | None = None
    name: str = ""
    count: int = 0
    problems: tuple[InputError, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def valid(self) -> bool:
        return not self.problems


def check_file(path: str, machine: Machine | None = None) -> Check:
    """Check a file of any kind: readings, differences, session or machine.

    Args:
        path: as the user gave it; "-" is standard input.
        machine: gives the joint limits; None as in `read_input`.

    Raises:
        UnreadableError: there is nothing to check.
    """
    source = None
    try:
        document = read_document(path)
        source = document.source
        return _checked(document, machine)
    except UnreadableError:
        raise
    except InvalidFileError as error:
        return Check(path, source, problems=error.problems)
    except InputError as error:
        return Check(path, source, problems=(error,))


def _checked(document: Document, machine: Machine | None) -> Check:
    path, source = document.path, document.source
    if is_yaml(document):
        tree = load_tree(document)
        keys = set(tree.value) if isinstance(tree.value, dict) else set()
        if "readings" not in keys and keys & (set(MachineModel.model_fields) - {"name"}):
            return Check(path, source, "machine", machine_from_tree(tree).name)
        readings, judge = readings_from_tree(tree, machine)
        return Check(path, source, "session", judge.name, len(readings), (), readings.remarks)
    measured, judge = input_from_document(document, machine)
    return Check(path, source, measured.kind, judge.name, len(measured), (), measured.remarks)
