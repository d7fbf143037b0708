"""What was entered in the controller, recorded in the machine file; and taken back."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from orthoglide_cal.causes import CAUSES, correcting
from orthoglide_cal.errors import UnusableResultError, UsageError, command
from orthoglide_cal.files.comp_table import Added
from orthoglide_cal.files.controller_file import ControllerFile, holds
from orthoglide_cal.files.input import Input
from orthoglide_cal.files.machine_file import StoredMachine, differing, with_history
from orthoglide_cal.inference import Verdict
from orthoglide_cal.model.cause import Estimate
from orthoglide_cal.model.machine import Corrections, Entered, Machine, Written, WrittenTable
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.results.answer import Answer
from orthoglide_cal.schema import Reason


class Correction(Estimate):
    """A parameter of a cause that acts, and what the controller's file does about it."""

    id: str  # of the cause
    gain_mm: float | None  # error of a carriage over its travel that this is; None for others
    left: Literal["", "no_place", "no_origin", "below_u"]  # why it is not corrected; "" where it is


@dataclass(frozen=True)
class Application:
    """A change of the machine file, and of the controller's if that is wanted; not written yet."""

    file: StoredMachine  # as it is
    entry: Entered  # what is recorded, or taken back
    undone: bool  # whether it is taken back
    then: StoredMachine  # the machine file as it will be
    given: Input | None = None  # the measurement; None where it is taken back
    controller: ControllerFile | None = None  # as it is; None where it is not written
    data: bytes = b""  # of the controller's file, as they will be
    corrections: tuple[Correction, ...] = ()

    @property
    def tables(self) -> tuple[WrittenTable, ...]:
        """Files beside the controller's that come or go with it."""
        return self.entry.written.tables if self.entry.written else ()

    @property
    def changes(self) -> bool:
        """False where nothing needs to be entered: then nothing is recorded, either."""
        return self.then is not self.file


def apply(
    given: Input,
    answer: Answer,
    file: StoredMachine,
    at: datetime,
    controller: ControllerFile | None = None,
    values: Callable[[Sequence[Correction]], Mapping[str, float]] = lambda made: {},
) -> Application:
    """Record the parameters of an answer as entered, and write them where that is wanted.

    What was active before is what the measurement says of it, not what stands in the file.

    Args:
        answer: to the input, released; one that needs nothing to be entered changes nothing.
        file: of the machine that was measured.
        controller: the controller's file, if it is to be written.
        values: gives what is to stand there with these corrections, parameter → value [mm, deg],
            where the file does not add.

    Raises:
        UsageError: the measurement is of another machine, or was applied before, or other
            offsets were entered after it; the controller's file is of another kind of machine, or
            does not hold what it held when that was measured.
    """
    source, adds = given.measured.source, controller is None or controller.adds
    machine = file.model.machine
    if controller is not None and controller.format != machine.controller_formats[0]:
        kind = "a LinuxCNC" if adds else "Klipper"
        raise UsageError(
            f"{controller.target} is of {kind} machine; {machine.name} is of kind {machine.kind}.",
            "Name the file of its own controller.",
        )
    if given.recorded is not None:
        # Causes may have been accepted since; rails and legs are what they were.
        _check_same_machine(given.recorded, file, but=("identified",))
    measured = given.model.machine
    before = dict(zip(measured.parameter_names, measured.active, strict=True)) if adds else None
    active = measured.corrected
    date = at.isoformat(timespec="milliseconds")
    entry = Entered(date=date, data_sha256=source.sha256, before=before, after=before)
    corrections = tuple(_corrections(given.model, answer, controller))
    made = [correction for correction in corrections if not correction.left]
    if not answer.release.needed and not made:
        return Application(file, entry, False, file)
    known = _last_written(file, controller)
    killed = controller and known and known.sha256_before == controller.sha256
    if killed and file.model.machine.history[-1].data_sha256 == source.sha256:
        # The program wrote the record, but not that file: as if nothing were recorded.
        file = take_back(file, source.sha256, controller).then
        known = _last_written(file, controller)
    if adds:
        _check_recordable(given, file)
    written, data, decimals = None, b"", answer.decimals
    amounts = {p.name: p.change(decimals) for p in answer.parameters}
    if controller is not None:
        # A file that was moved or copied holds what was written; that of another machine does not.
        stood = known or (_last_written(file) if adds else None)
        expected = {value.key: value.after for value in stood.values} if stood else {}
        if not adds:
            stands = controller.settings
            expected |= {stands[p.name].key: f"{p.active:.9g}" for p in answer.parameters}
        elif not stood:
            controller = replace(controller, remarks=(Reason.of("first_written"),))
        if differing := controller.differing(expected):
            since = "Somebody changed it since."
            if stood and not known:
                since = f"The last entry was written to another file: {stood.target}"
            instead = "enter the offsets by hand, and record them without --to."
            instead = instead if adds else "measure again with the present values."
            fault = f"{controller.target}: {differing} {since}"
            raise UsageError(fault, f"Restore it, or {instead}")
        tables = _tables(made, controller, machine) if adds else {}
        written, data = controller.changed(amounts if adds else values(made), decimals, tables)
    after = None
    if before is not None:
        after = {name: round(value + amounts[name], 9) for name, value in before.items()}
    entry = entry.changed(after=after, written=written)
    if corrected := [correction for correction in made if CAUSES[correction.id].by_joint]:
        entry = entry.changed(corrected_before=active, corrected=_added_to(active, corrected))
    then = with_history(file, entry.after, entry.corrected, *file.model.machine.history, entry)
    return Application(file, entry, False, then, given, controller, data, corrections)


def check_measured(given: Input, file: StoredMachine | None = None) -> None:
    """Raise UnusableResultError for simulated readings, unless the machine file is for practice."""
    if given.measured.source.simulated and not (file and file.model.machine.practice):
        raise UnusableResultError(
            "These readings are simulated: no controller takes them, and only a machine file made"
            " for practice records them.",
            "Measure the machine; or practise in another folder: orthocal machine new --practice",
        )


def _corrections(
    model: Model, answer: Answer, controller: ControllerFile | None
) -> Iterator[Correction]:
    """What is known to be wrong with the joints, or was named, and what may be done about it."""
    if controller is None:
        return
    machine = model.machine
    known = [(effect.cause, size) for effect in model.remaining() for size in model.called(effect)]
    if answer.verdict is Verdict.NAMED:
        known += [(CAUSES[c.id], size) for c in answer.causes for size in c.parameters]
    for cause, size in known:
        if not cause.in_machine:
            continue
        gain = None
        if cause.by_joint:
            (effect,) = correcting(machine, {cause.id: {size.name: size.value}})
            travel = machine.home_mm + np.array([0.0, machine.travel_mm])
            gain = float(np.ptp(cause.correction(-effect.theta, travel, machine.home_mm)))
        below = "below_u" if abs(size.value) <= size.expanded else ""
        left = controller.hindrance(cause, machine) or below
        yield Correction(id=cause.id, **dict(size), gain_mm=gain, left=left)


def _added_to(active: Corrections, made: Sequence[Correction]) -> Corrections:
    """The corrections in force with some more."""
    sums = {id: dict(values) for id, values in active.items()}
    for one in made:
        values = sums.setdefault(one.id, {})
        values[one.name] = float(f"{values.get(one.name, 0.0) + one.value:.9g}")
    return sums


def _tables(
    made: Sequence[Correction], controller: ControllerFile, machine: Machine
) -> dict[str, Added]:
    """What is to be added to each joint that is corrected, over its position as it counts."""
    effects = correcting(machine, _added_to({}, made))

    def added(index: int, origin: float, at: Floats) -> Floats:
        every = [e.cause.correction(-e.theta, at + origin, machine.home_mm) for e in effects]
        return np.asarray(np.sum(every, axis=0)[..., index])

    joints = {correction.name for correction in made}
    return {
        axis: partial(added, index, controller.tables[axis].origin_mm(machine.home_mm) or 0.0)
        for index, axis in enumerate(AXES)
        if axis in joints
    }


def recording(given: Input) -> Literal["due", "done", "nowhere", "elsewhere"]:
    """Return whether a machine file keeps what is entered after this measurement.

    Elsewhere: the controller itself does.
    """
    file = given.keeper
    if not given.model.machine.keeps_entered:
        return "elsewhere"
    if file is None:
        return "nowhere"
    if file.model.machine.entered_from(given.measured.source.sha256):
        return "done"
    with suppress(UsageError, UnusableResultError):
        check_measured(given, file)
        _check_recordable(given, file)
        return "due"
    return "nowhere"


def unwritten(file: StoredMachine) -> str | None:
    """The controller's file of the last entry, if the program was killed before it wrote it."""
    written = _last_written(file)
    if written is None or not written.values or not Path(written.target).is_file():
        return None
    return written.target if holds(written.target, written.sha256_before) else None


def _last_written(file: StoredMachine, controller: ControllerFile | None = None) -> Written | None:
    """Return what the last entry wrote to this controller's file, or to any; None for nothing."""
    *_, written = None, *(entry.written for entry in file.model.machine.history)
    elsewhere = written and controller and written.target != controller.target
    return None if elsewhere else written


def _check_same_machine(measured_on: Model, file: StoredMachine, but: Sequence[str] = ()) -> None:
    """Raises UsageError for the file of another machine than what was measured."""
    machine, measured = file.model.machine, measured_on.machine
    others = ["name"] if measured.name != machine.name else []
    others += [key for key in differing(measured_on, file.model) if key not in but]
    if others:
        raise UsageError(
            f"This was measured on {measured.name!r}, which differs from the machine of"
            f" {file.document.path}, {machine.name!r}, in: {', '.join(others)}.",
            "Name the machine file of both: --machine FILE",
        )


def _check_recordable(given: Input, file: StoredMachine) -> None:
    """Raises UsageError if what was entered from this measurement cannot be recorded there."""
    machine, path = file.model.machine, file.document.path
    source, before = given.measured.source, given.model.machine.active
    _check_same_machine(given.model, file)
    if earlier := machine.entered_from(source.sha256):
        raise UsageError(
            f"This measurement was applied already, on {earlier.date}.",
            "Measure again; or take it back, if it was not entered: "
            + command("apply", source.path, machine=Path(path), options="--undo"),
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
    """Undo the last entry: it leaves the history, and what was before it is active again.

    Args:
        file: the machine file.
        sha256: digest of the measurement that the last entry must come from; None for any.
        controller: the file that it was written to.

    Raises:
        UsageError: there is no such entry, or the offsets were changed since; it was written to
            another file, or that does not hold what was written any more.
    """
    machine, path = file.model.machine, file.document.path
    if not machine.history:
        raise UsageError(f"{path} records nothing that could be taken back.", "Check the file.")
    *history, last = machine.history
    if sha256 is not None and last.data_sha256 != sha256:
        raise UsageError(
            f"The last entry of {path}, of {last.date}, is from another measurement.",
            "Only the last one can be taken back: leave the measurement out, or name its own.",
        )
    if last.after is not None and machine.active != last.active[1]:
        raise UsageError(
            f"{path} holds {_joined(machine.active)} mm, not what was entered on {last.date}.",
            "It was changed by hand: change it back by hand.",
        )
    written, data = last.written, b""
    if written is None and controller is not None:
        raise UsageError(f"{path} records that nothing was written.", "Leave out --to.")
    if written and (controller is None or controller.target != written.target):
        again = command("apply", machine=Path(path), to=written.target, options="--undo")
        problem = f"The last entry of {path} was written to {written.target}."
        raise UsageError(problem, f"Restore that, too: {again}")
    if written and controller and controller.sha256 == written.sha256_before:
        controller = None  # the program was killed before it wrote that file
    elif written and controller:
        data = controller.restored(written)
    for table in written.tables if written else ():
        if Path(table.path).is_file() and not holds(table.path, table.sha256):
            problem = f"{table.path} was changed since it was written."
            raise UsageError(problem, "Nothing was changed. Remove COMP_FILE from the INI by hand.")
    then = with_history(file, last.before, last.corrected_before, *history)
    return Application(file, last, True, then, None, controller, data)


def _joined(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:+g}" for value in values)
