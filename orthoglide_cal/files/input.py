"""The inputs that a user names: read once, or only checked; and the sessions of a folder."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path, PurePath
from typing import Literal

from pydantic import ConfigDict, Field

from orthoglide_cal.errors import InputError, InvalidFileError, UsageError
from orthoglide_cal.files.differences import (
    DIFFERENCE_COLUMNS,
    check_header,
    differences_from_table,
)
from orthoglide_cal.files.machine_file import (
    PRINTER_SECTION,
    StoredMachine,
    default_machine,
    is_machine_file,
    machine_file_in,
)
from orthoglide_cal.files.printer_file import read_printer_file
from orthoglide_cal.files.probe_readings import (
    PLACE_COLUMNS,
    known_printer,
    printer_readings,
    probe_readings_from_table,
)
from orthoglide_cal.files.readings import (
    CODED_COLUMNS,
    Conditions,
    conditions_in,
    readings_from_table,
)
from orthoglide_cal.files.session_file import session_from_tree
from orthoglide_cal.files.table import read_table
from orthoglide_cal.files.text import YAML_LIMIT, FileText, UnreadableError, read_document
from orthoglide_cal.files.yaml_tree import load_tree
from orthoglide_cal.model import Measured, Model, gauge_doubts
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.schema import Schema

_CODED = (*DIFFERENCE_COLUMNS, *CODED_COLUMNS)
_YAML = re.compile(r"""(---|%YAML|\{|\[|-\s|["']?[A-Za-z_][A-Za-z_0-9 ]*["']?\s*:(\s|$))""")
# Keys at the beginning of a line; parsing every file of a large folder would take seconds.
_KEY = re.compile(
    r"^(machine|readings|finished|started|kind|leg_length_mm):[ \t]*(.*)$", re.MULTILINE
)

_DELTA = re.compile(r"^kinematics\s*[:=]\s*delta\b", re.MULTILINE | re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Input:
    """What was measured, on which machine and under which conditions.

    Attributes:
        measured: readings or differences.
        model: the machine to judge them by, with its accepted causes.
        conditions: as recorded.
        is_session: True for a session, False for a table.
        keeper: the machine file in which it is recorded what was entered in the controller; None
            where there is none.
    """

    measured: Measured
    model: Model
    conditions: Conditions
    is_session: bool
    keeper: StoredMachine | None = None


class CheckedFile(Schema):
    """A file that was checked; None if it was refused before its content was looked at."""

    path: str
    sha256: str | None = None
    kind: str | None = Field(None, description="readings, session, six, twelve, single or machine")
    readings: int = Field(0, description="readings, or differences")


class Fault(Schema):
    """What is wrong at one place of a file."""

    model_config = ConfigDict(from_attributes=True)

    line: int | None
    column: str | None = Field(description="of a table, or the dotted path of a key")
    value: str | None
    what: str
    remedy: str


class Check(Schema):
    """What a check found: the object of `validate --json`."""

    schema_version: Literal[1] = 1
    input: CheckedFile
    machine: str | None = Field(None, description="that the file holds, or is judged by")
    valid: bool = True
    problems: tuple[Fault, ...] = Field((), description="everything that is wrong")
    remarks: tuple[str, ...] = Field((), description="to know although nothing is wrong")
    refused: str | None = Field(None, description="why sound data give no offsets")


@dataclass(frozen=True, order=True)
class FoundSession:
    """A session file; they sort by time.

    Attributes:
        moment: when it was finished (else started, else when the file changed) [s since 1970].
        path: the file.
        dated: False if the moment is the file's.
    """

    moment: float
    path: Path
    dated: bool


def read_input(
    path: str,
    model: Model | None = None,
    otherwise: Callable[[], Model] = default_machine,
    stored: str | None = None,
) -> Input:
    """Readings or differences, from a CSV or a session file, each byte read once.

    Args:
        path: as the user gave it; "-" is standard input.
        model: the machine that the user names; it gives the joint limits that postures refer to.
            None stands for the one in a session.
        otherwise: gives the machine for a table where the user names none.
        stored: what of a printer.cfg is meant; None for its calibration, or else its mesh. Other
            files are read whole.

    Raises:
        InvalidFileError: everything that is wrong with its content, each with its place.
        InputError: not readable, too large, or not text.
    """
    return input_from_document(read_document(path), model, otherwise, stored)


def input_from_document(
    document: FileText,
    model: Model | None = None,
    otherwise: Callable[[], Model] = default_machine,
    stored: str | None = None,
) -> Input:
    """As `read_input`, from text that has been read."""
    if PRINTER_SECTION.search(document.text):
        return _printer(document, model, stored)
    if _is_yaml(document):
        return Input(*session_from_tree(load_tree(document), model), is_session=True)
    return _table(document, model, otherwise)


def check_file(
    path: str,
    model: Model | None = None,
    otherwise: Callable[[], Model] = default_machine,
    stored: str | None = None,
) -> tuple[Check, Input | None]:
    """Check a file of any kind: readings, differences, session or machine.

    Args:
        path: as the user gave it; "-" is standard input.
        model, otherwise, stored: as in `read_input`.

    Returns:
        What was found, and what was measured; None for a machine, or if the file is not valid.

    Raises:
        UnreadableError: there is nothing to check.
    """
    input = CheckedFile(path=path)
    try:
        file = read_document(path)
        input = input.changed(sha256=file.sha256)
        if _is_yaml(file) and not PRINTER_SECTION.search(file.text):
            tree = load_tree(file)
            if is_machine_file(tree):
                held = machine_file_in(tree)
                input, name = input.changed(kind="machine"), held.model.machine.name
                return Check(input=input, machine=name, remarks=held.remarks), None
            given = Input(*session_from_tree(tree, model), is_session=True)
        else:
            given = input_from_document(file, model, otherwise, stored)
    except UnreadableError:
        raise
    except InputError as error:
        problems = error.problems if isinstance(error, InvalidFileError) else (error,)
        faults = tuple(map(Fault.model_validate, problems))
        return Check(input=input, valid=False, problems=faults), None
    measured, machine = given.measured, given.model.machine
    kind = "session" if given.is_session else measured.kind
    doubts = (str(doubt) for doubt in gauge_doubts(measured, machine.instrument))
    check = Check(
        input=input.changed(kind=kind, readings=len(measured)),
        machine=machine.name,
        remarks=(*doubts, *measured.remarks),
    )
    return check, given


def sessions_in(folder: Path) -> list[FoundSession]:
    """All session files of a folder, recognised by their content, oldest first.

    Raises:
        InputError: there is no such folder.
    """
    if not folder.is_dir():
        raise InputError("There is no such folder.", "Check the path.", file=str(folder))
    found = (_dated(path, keys) for path, keys in _files_in(folder).items())
    return sorted(session for session in found if session is not None)


def latest_session(folder: Path) -> Path:
    """The session that was finished last. Raises InputError if there is none."""
    found = sessions_in(folder)
    if not found:
        raise InputError(
            "There is no session in this folder.",
            "Name a file of readings, or measure first: orthocal measure",
            file=str(folder),
        )
    return found[-1].path


def printers_in(folder: Path) -> list[Path]:
    """The files of a folder that describe a linear delta as Klipper reads them, latest last."""
    candidates = (path for path in folder.glob("*.cfg") if path.is_file())
    found = (path for path in candidates if _DELTA.search(_text_of(path)))
    return sorted(found, key=lambda path: (path.stat().st_mtime, path))


def machine_in_folder(folder: Path) -> Path | None:
    """The machine file of a folder, recognised by its content; None if it holds none.

    Raises:
        UsageError: it holds several.
    """
    own = {"kind", "leg_length_mm"}
    files = _files_in(folder).items()
    found = [path for path, keys in files if own & keys.keys() and "readings" not in keys]
    if len(found) > 1:
        names = ", ".join(path.name for path in found)
        raise UsageError(
            f"There are {len(found)} machine files in this folder: {names}.",
            "Say which one it is: --machine FILE",
        )
    return found[0] if found else None


def _text_of(path: Path) -> str:
    """Empty if it cannot be read, or is larger than any session."""
    try:
        return read_document(str(path), YAML_LIMIT).text
    except InputError:
        return ""


def _files_in(folder: Path) -> dict[Path, dict[str, str]]:
    """The YAML files of a folder: keys at the beginning of a line, and what stands behind them."""
    files = sorted(path for end in ("yaml", "yml") for path in folder.glob(f"*.{end}"))
    return {path: dict(reversed(_KEY.findall(_text_of(path)))) for path in files if path.is_file()}


def _dated(path: Path, keys: Mapping[str, str]) -> FoundSession | None:
    if not {"machine", "readings"} <= keys.keys():
        return None
    for key in ("finished", "started"):
        try:
            written = keys.get(key, "").strip().strip("'\"")
            return FoundSession(datetime.fromisoformat(written).timestamp(), path, True)
        except ValueError:
            continue
    return FoundSession(path.stat().st_mtime, path, False)


def _is_yaml(document: FileText) -> bool:
    """Whether the first line that says anything is YAML; the name decides what it leaves open."""
    if PurePath(document.path).suffix.lower() in (".yaml", ".yml", ".json"):
        return True
    for line in document.text.split("\n", 1000):
        if line.strip() and not line.lstrip().startswith("#"):
            return bool(_YAML.match(line))
    return False


def _table(document: FileText, model: Model | None, otherwise: Callable[[], Model]) -> Input:
    """A table says nothing of the controller: where offsets from it were entered, the machine
    file tells what was active before; else what is active now."""
    judge = model or otherwise()
    entered = judge.machine.entered_from(document.sha256)
    if entered:
        judge = judge.holding(entered.before)
    table = read_table(document, _CODED)
    columns = set(table.columns)
    if columns & set(PLACE_COLUMNS) and not columns & {"leg", "difference"}:
        if not isinstance(judge.machine, LinearDelta):
            raise InputError(
                "These are touches of a bed; the machine is no linear delta.",
                "Give its machine file: --machine FILE, see configs/linear_delta.yaml.",
                file=table.file.path,
                line=table.header_line,
            )
        touched = probe_readings_from_table(table, judge.machine)
        return Input(touched, judge, conditions_in(touched), is_session=False)
    check_header(table, _CODED)
    if isinstance(judge.machine, LinearDelta):
        raise InputError(
            "These are readings of gauges; the machine is a linear delta.",
            "Give the machine file of what was measured: --machine FILE",
            file=document.path,
            line=table.header_line,
        )
    if "difference" in table.columns:
        return Input(
            differences_from_table(table, judge.machine), judge, Conditions(), is_session=False
        )
    readings = readings_from_table(table, judge.orthoglide)
    return Input(readings, judge, conditions_in(readings), is_session=False)


def _printer(document: FileText, model: Model | None, stored: str | None = None) -> Input:
    """What a printer.cfg stores, on the machine that it describes.

    What else is known of the machine (its probe, tolerances, accepted causes) comes from the
    machine file that the user names, if any: one in the same folder may be another printer's.
    """
    file = read_printer_file(document)
    known = model or Model(file.machine)
    if not isinstance(known.machine, LinearDelta):
        raise UsageError(
            f"{document.path} is of a linear delta; the machine given is an {known.machine.kind}.",
            "Leave --machine out, or give a file of kind linear_delta.",
        )
    machine, remarks = known_printer(file, known.machine)
    read = printer_readings(file, stored, machine)
    readings = replace(read, remarks=(*remarks, *read.remarks))
    judge = replace(known, machine=machine)
    return Input(readings, judge, conditions_in(readings), is_session=False)
