"""Results of one machine over time: how its offsets drift, and when it was last adjusted.

What drifts is the total offset: the one active in the controller during a session plus the one
that the session still found. An adjustment moves only the first of the two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from orthoglide_cal.errors import InputError, OrthocalError, UsageError
from orthoglide_cal.estimation import Solution, solve
from orthoglide_cal.files import FoundSession, read_input, sessions_in
from orthoglide_cal.model import Floats
from orthoglide_cal.results.trend import DAY, Trend, trend
from orthoglide_cal.verification import require_limit


@dataclass(frozen=True, eq=False)
class Entry:
    """One session.

    Attributes:
        session: its file, and when it was finished.
        solution: what it says of the offsets beside those in the controller.
        adjusted: True if the controller's offsets differ from those of the session before.
        operator: None if not given.
    """

    session: FoundSession
    solution: Solution
    adjusted: bool
    operator: str | None

    @property
    def active_mm(self) -> Floats:
        """Offsets in the controller during the session, shape (3,) [mm]."""
        return np.array(self.solution.model.machine.offsets_mm)

    @property
    def total_mm(self) -> Floats:
        """True position − position without any correction, shape (3,) [mm]."""
        return self.active_mm + self.solution.offsets_mm


@dataclass(frozen=True)
class Drift:
    """Change of the total offsets between two sessions.

    Attributes:
        since: "the first session" or "the last adjustment".
        days: between the two.
        change_mm: last − first, one per axis.
        expanded_mm: expanded uncertainty of the change, one per axis; of what is the same in both
            sessions, as the lengths of the legs, a change knows nothing.
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


@dataclass(frozen=True, eq=False)
class History:
    """The sessions of one machine, oldest first, and what could not be used.

    Attributes:
        machine: name.
        folder: as the user gave it.
        entries: at least one.
        left_out: (file, reason).
        limit_mm: largest difference that is allowed; None if nobody said.
    """

    machine: str
    folder: str
    entries: tuple[Entry, ...]
    left_out: tuple[tuple[str, str], ...]
    limit_mm: float | None = None

    @cached_property
    def trend(self) -> Trend | None:
        """Lines through the total offsets; None if the sessions lie too close together."""
        return trend(
            [entry.session.moment for entry in self.entries],
            np.stack([entry.total_mm for entry in self.entries]),
            np.stack([entry.solution.budget.renewed.covariance_mm2 for entry in self.entries]),
        )

    @cached_property
    def due(self) -> float | None:
        """When the machine may drift beyond the limit [s]; None without limit, trend or drift."""
        last = self.entries[-1]
        if self.trend is None or self.limit_mm is None:
            return None
        return self.trend.due(last.solution.model, last.session.moment, self.limit_mm)

    @property
    def last_adjusted(self) -> float | None:
        """Moment of the first session with the present offsets; None if they never changed."""
        moments = [entry.session.moment for entry in self.entries if entry.adjusted]
        return moments[-1] if moments else None

    @property
    def drifts(self) -> tuple[Drift, ...]:
        """Since the first session and, if there was one later, since the last adjustment."""
        last = self.entries[-1]
        adjusted = [entry for entry in self.entries if entry.adjusted]
        starts = [("the first session", self.entries[0])]
        starts += [("the last adjustment", entry) for entry in adjusted[-1:]]
        return tuple(_drift(since, first, last) for since, first in starts if first is not last)


def history(folder: Path, machine: str | None = None, limit_mm: float | None = None) -> History:
    """Solve every session of one machine in a folder.

    Args:
        folder: its session files (*.yaml, *.yml) are read.
        machine: name of the machine; may be None if the folder holds only one.
        limit_mm: largest difference that is allowed; tells when the machine is due.

    Raises:
        InputError: no folder, or no usable session.
        UsageError: several machines and no name, or a limit that is none.
    """
    require_limit(limit_mm)
    left_out: list[tuple[str, str]] = []
    found: list[Entry] = []
    for session in sessions_in(folder):
        try:
            given = read_input(str(session.path))
            solution = solve(given.measured, given.model)
            found.append(Entry(session, solution, False, given.conditions.operator))
        except OrthocalError as error:
            place = f"{error.column}: " if isinstance(error, InputError) and error.column else ""
            left_out.append((session.path.name, place + error.what))
    names = sorted({entry.solution.machine for entry in found})
    if machine is None and len(names) > 1:
        raise UsageError(
            f"The folder holds sessions of {len(names)} machines: {', '.join(names)}.",
            "Choose one: --name NAME",
        )
    chosen = machine if machine is not None else (names[0] if names else "")
    entries = [entry for entry in found if entry.solution.machine == chosen]
    if not entries:
        reason = f" ({left_out[0][0]}: {left_out[0][1]})" if left_out else ""
        raise InputError(
            "There is no usable session of this machine in the folder" + reason + ".",
            "Name a folder with session files that `orthocal measure` wrote. A printer has none:"
            " compare two of its files, orthocal verify BEFORE AFTER",
            file=str(folder),
        )
    left_out += [
        (entry.session.path.name, f"Another machine: {entry.solution.machine}.")
        for entry in found
        if entry.solution.machine != chosen
    ]
    marked = [entries[0]]
    for before, entry in pairwise(entries):
        same = np.allclose(before.active_mm, entry.active_mm, rtol=0.0, atol=1e-9)
        marked.append(replace(entry, adjusted=not same))
    return History(chosen, str(folder), tuple(marked), tuple(left_out), limit_mm)


def _drift(since: str, first: Entry, last: Entry) -> Drift:
    change = last.total_mm - first.total_mm
    ends = (first.solution.budget.renewed, last.solution.budget.renewed)
    expanded = np.hypot(*(budget.expanded_mm for budget in ends))
    return Drift(
        since=since,
        days=(last.session.moment - first.session.moment) / DAY,
        change_mm=tuple(change.tolist()),
        expanded_mm=tuple(expanded.tolist()),
    )
