"""Values entered in the controller: recorded in the machine file, and taken back."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import (
    InputError,
    OrthocalError,
    UnusableResultError,
    UsageError,
    command,
)
from orthoglide_cal.files.controller_file import (
    ControllerFile,
    LinuxCnc,
    controller_file,
    holds,
    replace_file,
)
from orthoglide_cal.files.input import Input
from orthoglide_cal.files.machine_file import (
    StoredMachine,
    differing,
    new_machine_file,
    with_entry,
    without_entry,
)
from orthoglide_cal.files.moonraker import server
from orthoglide_cal.files.text import check_writable, write_text
from orthoglide_cal.inference.result import Verdict
from orthoglide_cal.model.machine import Corrections, Entered, Written, WrittenTable
from orthoglide_cal.model.measured import NOZZLE
from orthoglide_cal.model.model import Estimate, Model
from orthoglide_cal.results.answer import Answer
from orthoglide_cal.schema import Reason

# What is fitted is entered with the parameters, whatever its U.
Left = Literal["", "no_place", "no_origin", "below_u", "fitted"]


class Correction(Estimate):
    """A parameter of a cause that acts, and what the controller's file does about it."""

    id: str  # of the cause
    gain_mm: float | None  # error of a carriage over its travel that this is; None for others
    left: Left  # why it is not corrected; "" where it is


@dataclass(frozen=True)
class Application:
    """A change of the machine file, and of the controller's if that is wanted; not written yet."""

    file: StoredMachine  # as it is
    entry: Entered  # what is recorded, or taken back
    then: StoredMachine  # the machine file as it will be
    given: Input | None  # the measurement; None where the entry is taken back
    controller: ControllerFile | None = None  # as it is; None where it is not written
    written: Written | None = None  # what changes in it
    data: bytes = b""  # of it, as it will be
    corrections: tuple[Correction, ...] = ()
    remarks: tuple[Reason, ...] = ()  # what to know before it is written

    @property
    def changes(self) -> bool:
        """False where nothing needs to be entered, nor recorded."""
        return self.then is not self.file

    @property
    def tables(self) -> tuple[WrittenTable, ...]:
        """Files beside the controller's that come or go with it."""
        return self.entry.written.tables if self.entry.written else ()

    @cached_property
    def running(self) -> str | None:
        """Statement of its controller's file on a running LinuxCNC; None without one."""
        return self.controller.running() if self.controller else None

    @property
    def live(self) -> bool:
        """True if a running LinuxCNC can take the offsets without a restart."""
        return self.running == "" and not self.tables

    @property
    def address(self) -> str | None:
        """The server that holds the controller's file; None for a file of this computer."""
        return server(self.controller.target) if self.controller else None

    def check_writable(self) -> None:
        """Raise InputError for a file of this computer that cannot be written."""
        controller = [self.controller.target] if self.controller and not self.address else []
        for path in (self.file.document.path, *controller):
            check_writable(Path(path).resolve())

    def set_live(self) -> None:
        """Set what was written in the running LinuxCNC. Raises InputError: it does not take it."""
        written = controller_file(self.controller.target) if self.controller else None
        if not isinstance(written, LinuxCnc) or not written.is_live(anew=True):
            problem = "The running LinuxCNC does not take the offsets; its INI holds them."
            raise InputError(problem, "Restart LinuxCNC, then home.")

    def write(self) -> None:
        """Write the record, then the controller's file; what is taken back, in the other order.

        So the record never lacks what a controller holds, whenever the program is killed. Raises
        OrthocalError: a file cannot be written, or was changed meanwhile.
        """
        record, controller = self.file.document, self.controller
        new = not Path(record.path).exists()
        writes = [(record.path, record.sha256, self.then.document.data)]
        if controller is not None:
            writes.append((controller.target, controller.sha256, self.data))
        if self.given is None:
            writes.reverse()
        else:  # the name of a table holds its digest: it is new, or what a killed program left
            writes[:0] = [(table.path, table.sha256, table.text.encode()) for table in self.tables]
        for target, before, data in writes:
            try:
                replace_file(target, before, data)
            except OrthocalError:
                if writes[-1][0] == target != record.path and holds(target, before):
                    if new:
                        Path(record.path).unlink()
                    else:
                        write_text(Path(record.path).resolve(), record.data, overwrite=True)
                    self._remove_tables()
                raise
        if self.given is None:
            self._remove_tables()

    def _remove_tables(self) -> None:
        for table in self.tables:
            Path(table.path).unlink(missing_ok=True)


def apply(
    given: Input,
    answer: Answer,
    file: StoredMachine,
    at: datetime,
    controller: ControllerFile | None = None,
) -> Application:
    """Record the parameters of an answer as entered, and write them where that is wanted.

    Raises UsageError: the measurement is of another machine, was applied before, or other offsets
    were entered since; the controller's file is of another kind, or holds other values than then.
    """
    source, model = given.measured.source, given.model
    for machine in (file.model.machine, model.machine):
        if controller is not None and controller.format != machine.controller_formats[0]:
            fault = f"{controller.target} is a {controller.format} file; {machine.name} is of kind"
            raise UsageError(f"{fault} {machine.kind}.", "Name the file of its own controller.")
    if given.recorded:  # causes may have been accepted since; rails and legs are what they were
        _check_same_machine(given.recorded, file, but=("identified",))
    adds, digits = recording(given) != "elsewhere", answer.decimals
    before = {p.name: p.active for p in answer.parameters} if adds else None
    date, sha256 = at.isoformat(timespec="milliseconds"), source.sha256
    entry = Entered(date=date, data_sha256=sha256, before=before, after=before)
    corrections = tuple(_corrections(model, answer, controller)) if controller else ()
    made = [correction for correction in corrections if not correction.left]
    if not answer.release.needed and not made:
        return Application(file, entry, file, given)
    history = file.model.machine.history
    last = history[-1].written if history else None
    known = last if last and controller and last.target == controller.target else None
    killed = controller and known and known.sha256_before == controller.sha256
    if killed and history[-1].data_sha256 == sha256:
        # The program wrote the record, but not that file: as if nothing were recorded.
        return apply(given, answer, take_back(file, sha256, controller).then, at, controller)
    if adds:
        _check_recordable(given, file)
        entry = entry.changed(after={p.name: p.new(digits) for p in answer.parameters})
    if corrected := [correction for correction in made if CAUSES[correction.id].by_joint]:
        active = model.machine.corrected
        entry = entry.changed(corrected_before=active, corrected=_added_to(active, corrected))
    written, data, remarks = None, b"", list[Reason]()
    if controller is not None:
        # A file that was moved or copied holds what was written; that of another machine does not.
        stood = known or (last if adds else None)
        expected = {value.key: value.after for value in stood.values} if stood else {}
        if not adds:
            stands = controller.settings
            expected |= {stands[p.name].key: f"{p.active:.9g}" for p in answer.parameters}
        if unlike := controller.differing(expected):
            since, instead = "Somebody changed it since.", "measure again with the present values."
            if stood and not known:
                since = f"The last entry was written to another file: {stood.target}"
            if adds:
                instead = "enter the offsets by hand, and record them without --to."
            elif known and known.sha256_after == controller.sha256:
                since = "The last entry wrote that."
                instead = "state these settings in the machine file that you name."
            fault = f"{controller.target}: {unlike} {since}"
            raise UsageError(fault, f"Restore it, or {instead}")
        first = [Reason.of("first_written")] if adds and not stood else []
        nozzle = (remark for remark in given.measured.remarks if remark.code in NOZZLE)
        remarks = [*controller.remarks, *first, *nozzle]
        changes = {p.name: p.change(digits) for p in answer.parameters}
        written, data = controller.changed(model, changes, _added_to({}, made), digits)
    entry = entry.changed(written=written)
    then = with_entry(file, entry)
    return Application(
        file, entry, then, given, controller, written, data, corrections, tuple(remarks)
    )


def file_to_record_in(
    given: Input, file: StoredMachine | None, controller: ControllerFile | None
) -> StoredMachine | None:
    """The machine file that records what is entered; a new one where a printer has none yet.

    None: there has to be one. Raises UsageError: only the controller's file would hold it;
    UnusableResultError as `check_measured`.
    """
    check_measured(given, file, to_controller=controller is not None)
    if recording(given) == "elsewhere":
        if controller is None:
            path, machine = given.measured.source.path, given.machine_file
            options = f"--format {given.model.machine.controller_formats[0]}"
            shown = command("export", path, machine=machine, options=options)
            written = command("apply", path, machine=machine, options="--to printer.cfg")
            fault = "The printer's firmware keeps what it is given; nothing is recorded here."
            raise UsageError(fault, f"See what to give it: {shown}\nOr write it: {written}")
        file = file or new_machine_file(given.model, controller.target)
    return file


def check_measured(
    given: Input, file: StoredMachine | None = None, to_controller: bool = True
) -> None:
    """Raise UnusableResultError for what was practised: it goes into a file for practice only.

    What is judged by such a file, of no real machine, never reaches a controller.
    """
    practice = file is not None and file.model.machine.practice
    if given.measured.source.simulated and (to_controller or not practice):
        raise UnusableResultError(
            "These readings are simulated: no controller takes them, and only a machine file made"
            " for practice records them.",
            "Measure the machine; or practise in another folder: orthocal machine new --practice",
        )
    if to_controller and (practice or given.model.machine.practice):
        raise UnusableResultError(
            "The machine file was made for practice: it describes no real machine, and no"
            " controller takes what is judged by it.",
            "Name the file of the real machine (--machine FILE), or make it in another folder:"
            " orthocal machine new",
        )


def _corrections(model: Model, answer: Answer, controller: ControllerFile) -> Iterator[Correction]:
    """Faults of the joints, accepted or named, and whether the controller's file corrects them."""
    machine = model.machine
    known = [(effect.cause, size) for effect in model.remaining() for size in model.called(effect)]
    fitted = {effect.cause.id for effect in model.accepted}.intersection(machine.fixed_parameters)
    if answer.verdict is Verdict.NAMED:
        known += [(CAUSES[c.id], size) for c in answer.causes for size in c.parameters]
    for cause, size in known:
        if not cause.in_machine:
            continue
        gain = None
        if cause.by_joint:
            theta = -cause.correcting(machine, {size.name: size.value}).theta
            travel = machine.home_mm + np.array([0.0, machine.travel_mm])
            gain = float(np.ptp(cause.correction(theta, travel, machine.home_mm)))
        left: Left = controller.hindrance(cause, machine)
        if not left and abs(size.value) <= size.expanded:
            left = "fitted" if cause.id in fitted else "below_u"
        yield Correction(id=cause.id, **dict(size), gain_mm=gain, left=left)


def _added_to(active: Corrections, made: Sequence[Correction]) -> Corrections:
    sums = {id: dict(values) for id, values in active.items()}
    for one in made:
        values = sums.setdefault(one.id, {})
        values[one.name] = float(f"{values.get(one.name, 0.0) + one.value:.9g}")
    return sums


def recording(given: Input) -> Literal["due", "done", "nowhere", "elsewhere"]:
    """Return whether a machine file keeps what is entered; elsewhere: the controller does."""
    file = given.keeper
    if not given.model.machine.keeps_entered:
        return "elsewhere"
    if file is None:
        return "nowhere"
    if file.model.machine.entered_from(given.measured.source.sha256):
        return "done"
    with suppress(UsageError, UnusableResultError):
        check_measured(given, file, to_controller=False)
        _check_recordable(given, file)
        return "due"
    return "nowhere"


def unwritten(file: StoredMachine) -> str | None:
    """The controller's file of the last entry, if the program was killed before it wrote it."""
    history = file.model.machine.history
    written = history[-1].written if history else None
    if not (written and written.values and Path(written.target).is_file()):
        return None
    return written.target if holds(written.target, written.sha256_before) else None


def _check_same_machine(measured_on: Model, file: StoredMachine, but: Sequence[str] = ()) -> None:
    machine, measured = file.model.machine, measured_on.machine
    others = ["name"] if measured.name != machine.name else []
    if others := [*others, *(key for key in differing(measured_on, file.model) if key not in but)]:
        raise UsageError(
            f"This was measured on {measured.name!r}, which differs from the machine of"
            f" {file.document.path}, {machine.name!r}, in: {', '.join(others)}.",
            "Name the machine file of both: --machine FILE",
        )


def _check_recordable(given: Input, file: StoredMachine) -> None:
    machine, path = file.model.machine, file.document.path
    source, before = given.measured.source, given.model.machine.active
    _check_same_machine(given.model, file)
    if earlier := machine.entered_from(source.sha256):
        to = earlier.written and earlier.written.target
        raise UsageError(
            f"This measurement was applied already, on {earlier.date[:10]}.",
            "Measure again; or take it back, if it was not entered: "
            + command("apply", source.path, machine=Path(path), to=to, options="--undo"),
        )
    active, began = given.model.machine.corrected, given.conditions.started
    # A session that says what is active, and began after the last entry, says it as it is.
    newer = began is not None and all(
        datetime.fromisoformat(began).astimezone() > datetime.fromisoformat(entry.date).astimezone()
        for entry in machine.history[-1:]
    )
    if (before, active) != (machine.active, machine.corrected) and not newer:
        raise UsageError(
            f"This was measured with {_joined(before)} mm in the controller"
            f" ({', '.join(machine.parameter_names)}); since then {_joined(machine.active)} mm were"
            f" entered, or other corrections ({path}).",
            "Measure again, with what is in the controller now.",
        )


def take_back(
    file: StoredMachine, sha256: str | None = None, controller: ControllerFile | None = None
) -> Application:
    """Undo the last entry, of measurement `sha256` if given: what was before it is active again.

    Raises UsageError: there is none, the offsets or the controller's file were changed since, or it
    was written to another.
    """
    machine, path = file.model.machine, file.document.path
    if not machine.history:
        raise UsageError(f"{path} records nothing that could be taken back.", "Check the file.")
    last = machine.history[-1]
    if sha256 is not None and last.data_sha256 != sha256:
        fault = f"The last entry of {path}, of {last.date[:10]}, is from another measurement."
        remedy = "Only the last one can be taken back: leave the measurement out, or name its own."
        raise UsageError(fault, remedy)
    if last.after is not None and machine.active != last.active[1]:
        held, day = _joined(machine.active), last.date[:10]
        fault = f"{path} holds {held} mm, not what was entered on {day}."
        raise UsageError(fault, "It was changed by hand: change it back by hand.")
    written, data = last.written, b""
    if written is None and controller is not None:
        raise UsageError(f"{path} records that nothing was written.", "Leave out --to.")
    if written and (controller is None or controller.target != written.target):
        again = command("apply", machine=Path(path), to=written.target, options="--undo")
        problem = f"The last entry of {path} was written to {written.target}."
        raise UsageError(problem, f"Restore that, too: {again}")
    for table in written.tables if written else ():
        if Path(table.path).is_file() and not holds(table.path, table.sha256):
            problem = f"{table.path} was changed since it was written."
            raise UsageError(problem, "Nothing was changed. Remove COMP_FILE from the INI by hand.")
    if written and controller and controller.sha256 == written.sha256_before:
        controller = written = None  # the program was killed before it wrote that file
    elif written and controller:
        written, data = controller.restored(written)
    then = without_entry(file)
    remarks = controller.remarks if controller else ()
    return Application(file, last, then, None, controller, written, data, (), remarks)


def _joined(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:+g}" for value in values)
