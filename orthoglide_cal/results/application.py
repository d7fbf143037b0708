"""What was entered in the controller, recorded in the machine file; and taken back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import Enum

from orthoglide_cal.errors import UsageError, command
from orthoglide_cal.files import Conditions, Input, StoredMachine, differing, with_history
from orthoglide_cal.model import Entered, Model
from orthoglide_cal.results.answer import Answer


class Recording(Enum):
    """Whether a machine file keeps what was entered in the controller after a measurement."""

    DUE = "due"
    DONE = "done"
    NOWHERE = "nowhere"


@dataclass(frozen=True)
class Application:
    """A change of the machine file, not written yet.

    Attributes:
        file: the machine file as it is.
        entry: what is recorded, or taken back.
        undone: True if it is taken back.
        text: the machine file as it will be.
        conditions: of the measurement; None where it is taken back.
    """

    file: StoredMachine
    entry: Entered
    undone: bool
    text: str
    conditions: Conditions | None = None

    @property
    def before_mm(self) -> tuple[float, ...]:
        """Offsets in the controller until then (x, y, z) [mm]."""
        return self.entry.after if self.undone else self.entry.before

    @property
    def after_mm(self) -> tuple[float, ...]:
        """Offsets in the controller from then on (x, y, z) [mm]."""
        return self.entry.before if self.undone else self.entry.after


def apply(
    given: Input,
    answer: Answer,
    file: StoredMachine,
    at: datetime,
    measured_on: Model | None = None,
) -> Application:
    """Record the offsets of an answer as entered.

    What was active before is what the measurement says of it, not what stands in the file.

    Args:
        given: the input.
        answer: to it, released.
        file: of the machine that was measured.
        at: the time.
        measured_on: what the session itself says of its machine; None without a session.

    Raises:
        UsageError: the measurement is of another machine, or was applied before, or other
            offsets were entered after it.
    """
    machine = file.model.machine
    obstacle = _obstacle(given, file)
    if measured_on is not None:
        # Causes may have been accepted since; rails and legs are what they were.
        obstacle = _other_machine(measured_on, file, but=("identified",)) or obstacle
    if obstacle is not None:
        raise obstacle
    before = given.model.orthoglide.offsets_mm
    after = tuple(each.new(answer.decimals) for each in answer.parameters)
    sha256 = given.measured.source.sha256
    date = at.isoformat(timespec="milliseconds")
    entry = Entered(date=date, before=before, after=after, data_sha256=sha256)
    text = with_history(file, after, *machine.history, entry)
    return Application(file, entry, False, text, given.conditions)


def recording(given: Input) -> Recording:
    """Whether what is entered from this measurement can be recorded, or was."""
    file = given.keeper
    if file is None or given.model.machine.keeps_itself:
        return Recording.NOWHERE
    if file.model.machine.entered_from(given.measured.source.sha256):
        return Recording.DONE
    return Recording.DUE if _obstacle(given, file) is None else Recording.NOWHERE


def _other_machine(
    measured_on: Model, file: StoredMachine, but: Sequence[str] = ()
) -> UsageError | None:
    """Whether a machine file is of another machine than what was measured."""
    machine, measured = file.model.machine, measured_on.machine
    others = ["name"] if measured.name != machine.name else []
    others += [key for key in differing(measured_on, file.model) if key not in but]
    if not others:
        return None
    return UsageError(
        f"This was measured on {measured.name!r}, which differs from the machine of"
        f" {file.document.path}, {machine.name!r}, in: {', '.join(others)}.",
        "Name the machine file that both are of: --machine FILE",
    )


def _obstacle(given: Input, file: StoredMachine) -> UsageError | None:
    """Why what was entered from this measurement cannot be recorded there."""
    machine, path = file.model.orthoglide, file.document.path
    source, measured = given.measured.source, given.model.machine
    other = _other_machine(given.model, file)
    if other is not None:
        return other
    earlier = machine.entered_from(source.sha256)
    if earlier:
        return UsageError(
            f"This measurement was applied already, on {earlier.date}.",
            "Measure again; or take it back, if it was not entered: "
            + command("apply", source.path, options="--undo"),
        )
    before = measured.active
    if before != machine.offsets_mm and not _newer(given.conditions.started, machine.history):
        return UsageError(
            f"This was measured with {_triple(before)} mm in the controller (x, y, z);"
            f" since then {_triple(machine.offsets_mm)} mm were entered, says {path}.",
            "Measure again, with what is in the controller now.",
        )
    return None


def take_back(file: StoredMachine, sha256: str | None = None) -> Application:
    """Undo the last entry: it leaves the history, and the offsets before it are active again.

    Args:
        file: the machine file.
        sha256: digest of the measurement that the last entry must come from; None for any.

    Raises:
        UsageError: there is no such entry, or the offsets were changed since.
    """
    machine, path = file.model.orthoglide, file.document.path
    if not machine.history:
        raise UsageError(f"{path} records nothing that could be taken back.", "Check the file.")
    *history, last = machine.history
    if sha256 is not None and last.data_sha256 != sha256:
        raise UsageError(
            f"The last entry of {path}, of {last.date}, comes from another measurement.",
            "Only the last one can be taken back: leave the measurement out, or name its own.",
        )
    if machine.offsets_mm != last.after:
        raise UsageError(
            f"{path} holds {_triple(machine.offsets_mm)} mm, not what was entered on {last.date}.",
            "It was changed by hand: change it back by hand, too.",
        )
    return Application(file, last, True, with_history(file, last.before, *history))


def _newer(started: str | None, history: tuple[Entered, ...]) -> bool:
    """Whether a session that says what is active began after the last entry."""
    if started is None:
        return False
    if not history:
        return True
    began, last = (datetime.fromisoformat(each) for each in (started, history[-1].date))
    return began.astimezone() > last.astimezone()


def _triple(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:+g}" for value in values)
