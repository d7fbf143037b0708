"""Results of one machine over time: how its offsets drift, and when it was last adjusted.

What drifts is the total offset: the one active in the controller during a session plus the one
that the session still found. An adjustment moves only the first of the two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import machine_effects
from orthoglide_cal.errors import InputError, OrthocalError, UsageError
from orthoglide_cal.estimation import solve
from orthoglide_cal.outcome.answer import plain_answer
from orthoglide_cal.outcome.case import read_case
from orthoglide_cal.outcome.folder import FoundSession, sessions_in


@dataclass(frozen=True, eq=False)
class Entry:
    """One session.

    Attributes:
        path: the file.
        moment: when it was finished [s since 1970].
        dated: False if the moment is only that of the file.
        active_mm: offsets in the controller during the session, shape (3,).
        found_mm: offsets that the session found beside them, shape (3,).
        expanded_mm: their expanded uncertainty, shape (3,).
        rms_before_mm, rms_after_mm: of the session's fit.
        adjusted: True if the controller's offsets differ from those of the session before.
        operator: None if not given.
    """

    path: str
    moment: float
    dated: bool
    active_mm: Floats
    found_mm: Floats
    expanded_mm: Floats
    rms_before_mm: float
    rms_after_mm: float
    adjusted: bool
    operator: str | None

    @property
    def total_mm(self) -> Floats:
        """True position − position without any correction, shape (3,) [mm]."""
        return self.active_mm + self.found_mm


@dataclass(frozen=True)
class Drift:
    """Change of the total offsets between two sessions.

    Attributes:
        since: "the first session" or "the last adjustment".
        days: between the two.
        change_mm: last − first, one per axis.
        expanded_mm: expanded uncertainty of the change, one per axis.
    """

    since: str
    days: float
    change_mm: tuple[float, ...]
    expanded_mm: tuple[float, ...]

    @property
    def moved(self) -> tuple[bool, ...]:
        """Axes whose change is larger than its expanded uncertainty."""
        pairs = zip(self.change_mm, self.expanded_mm, strict=True)
        return tuple(abs(change) > expanded for change, expanded in pairs)


@dataclass(frozen=True)
class History:
    """The sessions of one machine, oldest first, and what could not be used.

    Attributes:
        machine: name.
        folder: as the user gave it.
        entries: at least one.
        drifts: since the first session and, if there was one later, since the last adjustment;
            empty with one session.
        last_adjusted: moment of the first session with the present offsets; None if they
            never changed.
        left_out: (file, reason).
    """

    machine: str
    folder: str
    entries: tuple[Entry, ...]
    drifts: tuple[Drift, ...]
    last_adjusted: float | None
    left_out: tuple[tuple[str, str], ...]


def history(folder: Path, machine: str | None = None) -> History:
    """Solve every session of one machine in a folder.

    Args:
        folder: its session files (*.yaml, *.yml) are read.
        machine: name of the machine; may be None if the folder holds only one.

    Raises:
        InputError: no folder, or no usable session.
        UsageError: several machines and no name.
    """
    left_out: list[tuple[str, str]] = []
    found: list[tuple[str, Entry]] = []
    for session in sessions_in(folder):
        try:
            found.append(_entry(session))
        except OrthocalError as error:
            place = f"{error.column}: " if isinstance(error, InputError) and error.column else ""
            left_out.append((session.path.name, place + error.what))
    names = sorted({name for name, _ in found})
    if machine is None and len(names) > 1:
        raise UsageError(
            f"The folder holds sessions of {len(names)} machines: {', '.join(names)}.",
            "Choose one: --name NAME",
        )
    chosen = machine if machine is not None else (names[0] if names else "")
    entries = [entry for name, entry in found if name == chosen]
    if not entries:
        reason = f" ({left_out[0][0]}: {left_out[0][1]})" if left_out else ""
        raise InputError(
            "There is no usable session of this machine in the folder" + reason + ".",
            "Name a folder with session files that `orthocal measure` wrote.",
            file=str(folder),
        )
    others = [(name, entry) for name, entry in found if name != chosen]
    left_out += [(Path(entry.path).name, f"Another machine: {name}.") for name, entry in others]
    ordered = _with_adjustments(entries)
    adjusted = [entry for entry in ordered if entry.adjusted]
    return History(
        machine=chosen,
        folder=str(folder),
        entries=ordered,
        drifts=_drifts(ordered),
        last_adjusted=adjusted[-1].moment if adjusted else None,
        left_out=tuple(left_out),
    )


def _entry(session: FoundSession) -> tuple[str, Entry]:
    case = read_case(str(session.path))
    machine = case.machine
    solution = solve(case.measured, machine, effects=machine_effects(machine))
    answer = plain_answer(solution)
    entry = Entry(
        path=str(session.path),
        moment=session.moment,
        dated=session.dated,
        active_mm=np.array(machine.offsets_mm),
        found_mm=solution.offsets_mm,
        expanded_mm=answer.expanded_mm,
        rms_before_mm=solution.rms_before_mm,
        rms_after_mm=solution.rms_after_mm,
        adjusted=False,
        operator=case.conditions.operator,
    )
    return machine.name, entry


def _with_adjustments(entries: list[Entry]) -> tuple[Entry, ...]:
    marked = [entries[0]]
    for before, entry in pairwise(entries):
        changed = not np.allclose(before.active_mm, entry.active_mm, rtol=0.0, atol=1e-9)
        marked.append(replace(entry, adjusted=changed))
    return tuple(marked)


def _drifts(entries: tuple[Entry, ...]) -> tuple[Drift, ...]:
    adjusted = max((k for k, entry in enumerate(entries) if entry.adjusted), default=0)
    starts = (
        {0: "the first session", adjusted: "the last adjustment"}
        if adjusted
        else {0: "the first session"}
    )
    return tuple(
        _drift(since, entries[k], entries[-1])
        for k, since in starts.items()
        if k < len(entries) - 1
    )


def _drift(since: str, first: Entry, last: Entry) -> Drift:
    change = last.total_mm - first.total_mm
    expanded = np.hypot(first.expanded_mm, last.expanded_mm)
    return Drift(
        since=since,
        days=(last.moment - first.moment) / 86400.0,
        change_mm=tuple(change.tolist()),
        expanded_mm=tuple(expanded.tolist()),
    )
