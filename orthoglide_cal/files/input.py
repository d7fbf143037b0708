"""The inputs that a user names: read, joined, or only checked; and the sessions of a folder."""

import hashlib
import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from glob import escape
from itertools import pairwise
from operator import itemgetter
from pathlib import Path, PurePath
from typing import Annotated, Literal, NamedTuple, Self, cast

import numpy as np
from pydantic import Field, InstanceOf, PlainSerializer

from orthoglide_cal.errors import InputError, UnusableResultError, UsageError, visible
from orthoglide_cal.files import gcode, klipper, machine_file
from orthoglide_cal.files.controller_file import ControllerFile
from orthoglide_cal.files.printer_file import ARMS, PrinterFile
from orthoglide_cal.files.readings import (
    Conditions,
    conditions_in,
    implausible_temperatures,
    measured_in,
    session_from_tree,
)
from orthoglide_cal.files.text import FileText, document_from_bytes, read_bytes, read_document
from orthoglide_cal.files.tree import YAML_LIMIT, load_tree
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.machine import Entered
from orthoglide_cal.model.measured import CAUTIONS, Excerpt, Measured, Readings, notes_on
from orthoglide_cal.model.model import Model, differentiate
from orthoglide_cal.schema import MACHINE_FILE, Reason, Schema, Sentence

# The machine that the user names, or the settings of its firmware.
Known = Model | PrinterFile

_YAML = re.compile(r"""(---|%YAML|\{|\[|-\s|["']?[A-Za-z_][A-Za-z_0-9 ]*["']?\s*:(\s|$))""")
# Keys at the beginning of a line; parsing every file of a large folder would take seconds.
_KEY = re.compile(
    r"^(machine|readings|finished|started|kind|leg_length_mm):[ \t]*(.*)$", re.MULTILINE
)

ADJUSTMENT = ".adjust"  # ending of the journal of one, not that of a session
# The header of a table of gauge readings, or of differences.
_GAUGED = re.compile(
    r"^(?!#)(?=.*\b(?:leg|difference|x_mm)\b).*\b(?:reading_mm|reading_in|value_mm)\b", re.M | re.I
)
_DELTA = re.compile(r"^kinematics\s*[:=]\s*delta\b", re.MULTILINE | re.IGNORECASE)
# A date in the name of a file, perhaps with the time.
_IN_NAME = re.compile(r"(?<!\d)(20\d\d-?[01]\d-?[0-3]\d)(?:[ _T-](\d{4}(?:\d\d)?))?(?!\d)")


class _Format(NamedTuple):
    """Form of a text that is neither YAML nor a table of ours, recognised by a mark in it."""

    title: str
    mark: re.Pattern[str]
    remedy: str = ""  # where nothing says which printer it is from, or it holds no readings
    firmware: str = ""  # as an export names it
    # Reads what was probed, with the settings; None where it holds no readings.
    read: Callable[..., PrinterFile] | None = None
    # Reads the settings, in the same file or beside it; None where `read` does.
    settings: Callable[[FileText], PrinterFile | None] | None = gcode.own_codes


_NAME = "Name its settings: --machine "
_GIVE = "Give the readings: a CSV, a session, or a printer's file."
# The first whose mark is there.
_FORMATS = (
    _Format("Klipper's log", klipper.KLIPPY_LOG, read=klipper.read_klippy_log, settings=None),
    _Format("a printer.cfg", machine_file.PRINTER_SECTION,
            read=klipper.read_printer_file, settings=None),
    _Format("a height map of RepRapFirmware", gcode.HEIGHT_MAP, _NAME + "config.g",
            "reprapfirmware", gcode.read_height_map, gcode.codes_beside),
    _Format("what Klipper's console prints", klipper.PROBED, _NAME + "printer.cfg",
            "klipper", klipper.read_probed, klipper.settings_beside),
    _Format("what Marlin or MarlinKimbra prints", gcode.MARLIN_OUTPUT,
            _NAME + "FILE, or keep what M503 prints in this file", "marlin", gcode.read_marlin),
    _Format("what RepRapFirmware's console prints", gcode.PROBE_HEIGHTS, _NAME + "config.g",
            "reprapfirmware", gcode.read_listed, gcode.codes_beside),
    _Format("a map of Repetier (G33)", gcode.REPETIER_MAP, _NAME + "FILE",
            "text", gcode.read_listed),
    _Format("what Repetier prints while it probes", re.compile(r"\bZ-probe: ?[-\d.]+ X:", re.I),
            "Give its map: what G33 L0 prints."),
    _Format("a firmware's settings file", gcode.SETTINGS,
            "Give what was probed, such as heightmap.csv, and this file by --machine."),
    _Format("a journal of orthocal", re.compile(r'\A\{"crc32":'), _GIVE),
    _Format("LinuxCNC's INI", re.compile(r"^\[(EMC|KINS|TRAJ|JOINT_\d)\]", re.MULTILINE), _GIVE),
    _Format("G-code", re.compile(r"\A(?:[ \t]*(?:;.*)?\n)*[GM]\d+\b"), _GIVE),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Input:
    """A measurement, its machine and its conditions."""

    measured: Measured
    model: Model  # the machine to judge it by, with its accepted causes
    conditions: Conditions
    recorded: Model | None = None  # the machine as a session itself holds it; None for no session
    keeper: machine_file.StoredMachine | None = None  # where what was entered is recorded
    others: tuple["Input", ...] = ()  # the other measurements that the same file stores
    machine_file: Path | None = None  # as the user gave it, for the commands to run next

    @property
    def is_session(self) -> bool:
        return self.recorded is not None

    @property
    def name(self) -> str:
        """Name of its file, without the folder."""
        return PurePath(self.measured.source.path).name

    @property
    def moment(self) -> datetime | None:
        """Time when it was measured: as it says, else as its name says."""
        named = _IN_NAME.search(self.name)
        name = "T".join(filter(None, named.groups())).replace("-", "") if named else ""
        with suppress(ValueError):
            moment = datetime.fromisoformat((self.conditions.started or name).strip())
            return moment.replace(tzinfo=moment.tzinfo or UTC)
        return None

    def precedes(self, entry: Entered) -> bool:
        """True if it was measured before this entry, as its date and the values active then say."""
        moment, entered = self.moment, datetime.fromisoformat(entry.date)
        active = self.model.machine.active == entry.active[0]
        entered = entered.replace(tzinfo=entered.tzinfo or UTC)
        return active and moment is not None and moment < entered


class InputFile(Schema):
    """A file that was judged or checked; null where it was refused before it was read."""

    path: str
    sha256: str | None = None
    kind: str | None = Field(None, description="readings, six, twelve or single")
    readings: int = Field(0, description="readings, or differences")
    data: str | None = Field(None, description="which measurement of a printer.cfg")

    @classmethod
    def of(cls, given: Input, **more: object) -> Self:
        """The file of an input; `more` are other values, and those of further fields."""
        measured, source = given.measured, given.measured.source
        known = {"path": source.path, "sha256": source.sha256, "kind": measured.kind}
        data = source.excerpt.data if source.excerpt else None
        return cls.model_validate({**known, "readings": len(measured), "data": data, **more})


_PRINTED = ("line", "column", "value", "what", "remedy")  # of a fault; its file is the input
Fault = Annotated[
    InstanceOf[InputError],
    PlainSerializer(lambda fault: {name: getattr(fault, name) for name in _PRINTED}),
]


class Check(Schema):
    """Result of a check: the object of `validate --json`."""

    schema_version: Literal[1] = 1
    input: InputFile
    machine: str | None = None  # that the file holds, or is judged by
    valid: bool = True
    simulated: bool = False  # some of it, or all
    problems: tuple[Fault, ...] = ()  # everything that is wrong
    doubtful: bool = False  # some of the remarks say that it cannot be so
    remarks: tuple[Sentence, ...] = ()  # to know although nothing is wrong
    # Why sound data give no offsets.
    refused: Annotated[InstanceOf[UnusableResultError], PlainSerializer(str, str)] | None = None


def read_input(
    source: str | FileText,
    model: Known | None = None,
    otherwise: Callable[[], Model] = machine_file.default_machine,
    stored: str | None = None,
) -> Input:
    """Readings or differences, from a CSV, a session or a printer's file, each byte read once.

    Args:
        source: path as the user gave it ("-" is standard input), or text that has been read.
        model: the machine that the user names, or the settings of its firmware; None for that in a
            session.
        otherwise: gives the machine for a table where the user names none.
        stored: what of a printer's file is meant; None for its calibration, or else its mesh.

    Raises InputError: every fault of its content with its place; or not readable, too large, or
    not text.
    """
    document = source if isinstance(source, FileText) else read_document(source)
    format, known = _format_of(document), model
    if isinstance(known, PrinterFile):
        known = Model(known.on_bed(known.machine.delta_radius_mm).machine)
    if _is_yaml(document, format):
        return Input(*session_from_tree(load_tree(document), known))
    if format:
        return _printer(_firmware_file(document, format, model, otherwise), known, stored)
    # A table says nothing of the controller: where offsets from it were entered, the machine file
    # tells what was active before; else what is active now.
    judge = known or otherwise()
    entered = judge.machine.entered_from(document.sha256)
    if entered and entered.before:
        judge = judge.holding(entered.active[0], entered.corrected_before)
    measured = measured_in(document, judge.machine)
    return Input(measured, judge, conditions_in(measured))


def check_file(
    path: str,
    model: Known | None = None,
    otherwise: Callable[[], Model] = machine_file.default_machine,
    stored: str | None = None,
) -> tuple[Check, Input | None]:
    """Check a file of any kind, also of a machine; the arguments are those of `read_input`.

    Returns the measurement, too; None for a machine, or if the file is not valid. Raises
    InputError: the file cannot be opened.
    """
    input, data = InputFile(path=path), read_bytes(path)
    try:
        file = document_from_bytes(data, path)
        input = input.changed(sha256=file.sha256)
        tree = load_tree(file) if _is_yaml(file, _format_of(file)) else None
        if tree and machine_file.is_machine_file(tree):
            machine = machine_file.machine_file_in(tree).model.machine
            input, doubts = input.changed(kind="machine"), machine.instrument.implausible().values()
            named = {"input": input, "machine": machine.name}
            return Check(**named, doubtful=bool(doubts), remarks=tuple(doubts)), None
        given = read_input(file, model, otherwise, stored)
    except InputError as error:
        return Check(input=input, valid=False, problems=error.problems), None
    measured, machine = given.measured, given.model.machine
    beyond = (
        *machine.instrument.doubts(measured),
        *machine.instrument.implausible().values(),
        *implausible_temperatures(given.conditions.temperatures_c),
    )
    check = Check(
        input=InputFile.of(given, kind="session" if given.is_session else measured.kind),
        machine=machine.name,
        simulated=measured.source.simulated,
        doubtful=bool(beyond) or len(notes_on(measured)) < len(measured.remarks),
        remarks=(*beyond, *measured.remarks),
    )
    return check, given


def copies_in(inputs: Sequence[Input]) -> dict[int, int]:
    """Number of an input that holds the readings of an earlier one → number of that one.

    A printer's file is stored again with the same calibration: what is measured once counts once.
    """
    first, copies = dict[bytes | str, int](), {}
    for k, given in enumerate(inputs):
        read, excerpt = given.measured, given.measured.source.excerpt
        values = read.value.tobytes() if isinstance(read, Readings) else read.source.sha256
        key = (excerpt and excerpt.steps) or values
        if first.setdefault(key, k) != k:
            copies[k] = first[key]
    return copies


def require_distinct(inputs: Sequence[Input]) -> None:
    """Raise UsageError if one of them holds the readings of another."""
    for pair in copies_in(inputs).items():
        copy, earlier = (inputs[k].measured.source.path for k in pair)
        fault = f"{copy} holds the same readings as {earlier}: one measurement counts once."
        others = {data.measured.source.excerpt for data in inputs[pair[0]].others}
        other = "".join(f" Or try --data {excerpt.data}." for excerpt in others if excerpt)
        raise UsageError(fault, f"Name another measurement.{other}")


def in_order(inputs: Sequence[Input]) -> tuple[list[Input], list[datetime]]:
    """The inputs in order of time, and their times; as given, without, unless all have one."""
    dated = sorted([(at, one) for one in inputs if (at := one.moment)], key=itemgetter(0))
    if len(dated) < len(inputs):
        return [*inputs], []
    return [given for _, given in dated], [at for at, _ in dated]


def require_order(first: Input, second: Input, right: str) -> bool:
    """True if dates, or else what was entered and when, say that the first was measured first.

    False if nothing says which was. Raises UsageError, with the `right` command: the second was.
    """
    history = first.keeper.model.machine.history if first.keeper else ()
    digests = [entry.data_sha256 for entry in history]
    one, other = (given.measured.source.sha256 for given in (first, second))
    # With what was entered active in the first and not yet in the second, or as it should be.
    held, then = (given.model.machine.active for given in (first, second))
    changes = [entry.active for entry in history if then != held]
    known = True
    if first.moment and second.moment and first.moment != second.moment:
        swapped = first.moment > second.moment
    elif other in digests:
        swapped = one not in digests or digests.index(other) < digests.index(one)
    else:
        swapped = (then, held) in changes
        known = swapped or one in digests or (held, then) in changes
    if swapped:
        paths = second.measured.source.path, first.measured.source.path
        raise UsageError("{} was measured before {}.".format(*paths), f"Name it first: {right}")
    return known


def together(inputs: Sequence[Input]) -> Input:
    """One measurement of one machine, whose calibrated parameters are others on each date.

    The latest date is the last, and its parameters are found; how far those of another differ, but
    for the settings in force, is unknown. Raises UsageError: they are not all touches of one
    printer, or two hold the same.
    """
    require_distinct(inputs)
    last = inputs[-1]
    machine = last.model.machine
    zero = np.zeros(len(machine.parameter_names))
    dates = [(given.model.machine, given.measured) for given in inputs]
    plan, value = machine.together(dates, lambda now: differentiate(last.model, zero, now)[1])
    remarks = [
        Reason.of("other_settings", files=[given.name for given in pair], settings=names)
        for pair in pairwise(inputs)
        if (names := pair[0].model.machine.differing(pair[1].model.machine))
    ]
    unknown = []
    for given in inputs:
        if (excerpt := given.measured.source.excerpt) and excerpt.unknown:
            unknown.append(f"{given.name}: {excerpt.unknown}")
        for remark in given.measured.remarks:
            if remark.code in CAUTIONS:
                remark = remark.changed(data={**remark.data, "of_file": given.name})
            remarks += [remark] if remark not in remarks else []
    reads = [cast(Readings, given.measured) for given in inputs]
    *earlier, latest = sources = [read.source for read in reads]
    words = f"{len(plan)} readings of {len(inputs)} dates"
    source = replace(
        latest,
        sha256=hashlib.sha256("".join(source.sha256 for source in sources).encode()).hexdigest(),
        excerpt=replace(latest.excerpt or Excerpt("", ""), words=words, unknown=" ".join(unknown)),
        earlier=tuple(source.path for source in earlier),
        simulated=any(source.simulated for source in sources),
    )
    line, timed = np.concatenate([read.line for read in reads]), all(read.timed for read in reads)
    measured = Readings(plan, value, line, timed, source, remarks=tuple(remarks))
    return replace(last, measured=measured, others=())


def adjustments_by(path: str) -> list[Path]:
    """Journals of what was adjusted by the readings in a file."""
    measured = Path(path)
    return sorted(measured.parent.glob(f"{escape(measured.stem)}.*{ADJUSTMENT}"))


def sessions_in(folder: Path, tables: bool = False) -> list[Path]:
    """Session files, recognised by their content, by when they were finished, started or changed.

    With `tables` also those of readings or differences. Raises InputError: no such folder.
    """
    if not folder.is_dir():
        raise InputError("There is no such folder.", "Check the path.", file=str(folder))
    sessions = []
    for path, text in _texts_in(folder, "yaml", "yml"):
        keys = _keys_of(text)
        if {"machine", "readings"} <= keys.keys():
            moment = path.stat().st_mtime
            for key in ("started", "finished"):
                with suppress(ValueError):
                    written = keys.get(key, "").strip().strip("'\"")
                    moment = datetime.fromisoformat(written).timestamp()
            sessions.append((moment, path))
    for path, text in _texts_in(folder, "csv") if tables else ():
        if _GAUGED.search(text):
            sessions.append((path.stat().st_mtime, path))
    return [path for _, path in sorted(sessions)]


def printers_in(folder: Path) -> list[Path]:
    """The files of a folder that describe a linear delta to Klipper, latest last."""
    printers = (path for path, text in _texts_in(folder, "cfg") if _DELTA.search(text))
    return sorted(printers, key=lambda path: (path.stat().st_mtime, path))


def machine_in_folder(folder: Path) -> Path | None:
    """The machine file of a folder, recognised by its content. Raises UsageError for several."""
    machines = _machines_in(folder)
    if len(machines) > 1:
        names = ", ".join(path.name for path in machines)
        fault = f"There are {len(machines)} machine files in this folder: {names}."
        raise UsageError(fault, "Name the one to use: --machine FILE")
    return machines[0] if machines else None


def machine_of_controller(folder: Path, controller: ControllerFile) -> Path | None:
    """The machine file from which this controller was written, or that is of no controller yet."""
    free = []
    for path in _machines_in(folder):
        with suppress(InputError):  # of a faulty one nobody knows
            file = machine_file.read_machine_file(path)
            machine, made_for = file.model.machine, machine_file.made_for(file)
            targets = {entry.written.target for entry in machine.history if entry.written}
            if controller.target in targets or made_for == visible(controller.target):
                return path
            if not (targets or made_for) and controller.format in machine.controller_formats:
                free.append(path)
    return free[0] if len(free) == 1 else None


def _machines_in(folder: Path) -> list[Path]:
    """Files with a key of machines, and MACHINE_FILE whatever is left of it."""
    keys_of = {path: _keys_of(text) for path, text in _texts_in(folder, "yaml", "yml")}
    machines = (path for path, keys in keys_of.items() if "readings" not in keys)
    marks = {"kind", "leg_length_mm"}
    return [path for path in machines if path.name == MACHINE_FILE or marks & keys_of[path].keys()]


def _texts_in(folder: Path, *ends: str) -> Iterator[tuple[Path, str]]:
    """Files with these endings; what cannot be read, or is larger than any session, has no text."""
    for path in sorted(path for end in ends for path in folder.glob(f"*.{end}") if path.is_file()):
        text = ""
        with suppress(InputError):
            text = read_document(str(path)).text if path.stat().st_size <= YAML_LIMIT else ""
        yield path, text


def _keys_of(text: str) -> dict[str, str]:
    """Keys at the beginning of a line of YAML, and what stands behind them."""
    return dict(reversed(_KEY.findall(text)))


def _format_of(document: FileText) -> _Format | None:
    """The form of a text; None for YAML, or a table."""
    return next((format for format in _FORMATS if format.mark.search(document.text)), None)


def _is_yaml(document: FileText, format: _Format | None) -> bool:
    """True if the first line that says anything is YAML; the name decides what it leaves open."""
    if PurePath(document.path).suffix.lower() in (".yaml", ".yml", ".json"):
        return format is None or format.settings is not None
    lines = document.text.split("\n", 1000)
    first = next((line for line in lines if line.lstrip()[:1] not in ("", "#")), "")
    # "Recv: …" of a console looks like a key.
    return format is None and _YAML.match(first) is not None


def printer_settings(path: Path) -> PrinterFile | None:
    """Settings in a firmware's file; None for another kind. Raises InputError."""
    document = read_document(str(path))
    format = _format_of(document)
    if format and format.read and format.settings is None:
        return format.read(document)
    return gcode.own_codes(document)


def _firmware_file(
    document: FileText, format: _Format, known: Known | None, otherwise: Callable[[], Model]
) -> PrinterFile:
    if format.read is None:
        fault = f"This is {format.title}, not a file of readings."
        raise InputError(fault, format.remedy, file=document.path)
    if format.settings is None:
        return format.read(document)
    # Those that the user names, else those beside the touches, else the numbers of a machine file,
    # which do not tell where the probe is.
    stated = format.settings(document)
    if isinstance(known, PrinterFile):
        settings = replace(known, data={}, remarks=())
    elif stated and not (stated.unknown and known):
        bed = _delta(known, document.path).bed_radius_mm if known else math.nan
        settings = stated.on_bed(bed)
    else:
        if format.mark is gcode.HEIGHT_MAP and not known:
            gcode.check_delta(document)
        fault = f"This is {format.title}; it does not say which printer it is from."
        nothing = InputError(fault, format.remedy, file=document.path)
        machine = _delta(known or otherwise(), document.path, nothing)
        remarks = (Reason.of("probe_offset_unknown"),)
        settings = PrinterFile(machine, np.full(3, np.nan), document.source, remarks=remarks)
    settings = replace(settings, source=document.source, firmware=format.firmware)
    return format.read(document, settings)


def _delta(model: Model, path: str, refused: InputError | None = None) -> LinearDelta:
    """The machine that the user names for a printer's file; raises an error for another kind."""
    fault = f"{path} is of a linear delta; the machine given is of kind {model.machine.kind}."
    remedy = "Leave --machine out, or give a file of kind linear_delta."
    return LinearDelta.require(model.machine, refused or UsageError(fault, remedy))


def _printer(file: PrinterFile, known: Model | None, stored: str | None) -> Input:
    """Measurements that a printer's file stores, on the machine that it describes.

    What else is known of the machine (its probe, tolerances, accepted causes) comes from the
    machine file that the user names, if any: one in the same folder may be another printer's.
    """
    for readings in reversed(file.data.values()):
        widest = float(np.hypot(*readings.plan.spots.T[:2]).max())
        file = file.on_bed(widest or file.machine.delta_radius_mm)
    model = known or Model(file.machine)
    sure = ARMS in {effect.cause.id for effect in model.accepted}
    machine, remarks = file.known_as(_delta(model, file.source.path), sure)
    model = model.judging(Model(machine))  # arms that were accepted may have been entered since

    def read(name: str, *unused: Reason) -> Input:
        readings = file.readings(name, machine)
        readings = replace(readings, remarks=(*remarks, *readings.remarks, *unused))
        return Input(readings, model, conditions_in(readings).changed(started=file.started))

    others, unused = [], []
    chosen = stored or next(iter(file.data), "")
    for name in (name for name in file.data if name != chosen):
        try:
            others.append(read(name))
        except InputError as error:
            why = {"what": error.what, "remedy": error.remedy}
            unused.append(Reason.of("unused_data", data=name, **why))
    return replace(read(chosen, *unused), others=tuple(others))
