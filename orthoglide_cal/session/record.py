"""A session's files: `session.yaml` in the end, `session.journal` meanwhile."""

from __future__ import annotations

import os
from itertools import chain, count
from pathlib import Path

from orthoglide_cal.errors import UsageError, command
from orthoglide_cal.files import GaugeIdentity, Session, session_text
from orthoglide_cal.session.following import PriorReadings
from orthoglide_cal.session.readings import ReadingsSoFar
from orthoglide_cal.session.state import State

JOURNAL = ".journal"
_LONGEST = 200  # bytes; file systems take 255, also of the temporary file's name


def journal_path(session: Path) -> Path:
    """The journal of a session file."""
    return session.with_suffix(JOURNAL)


def session_path(given: Path) -> Path:
    """The session file that is meant by a name, be it that of its journal or without a suffix.

    Raises:
        UsageError: it cannot be the name of a file.
    """
    if given.name in ("", ".."):
        raise UsageError(
            "A session must be a file; this is not one.",
            "Name a file, such as session.yaml, or leave the name out.",
        )
    if len(os.fsencode(given.name)) > _LONGEST:
        raise UsageError("The name of the file is too long.", "Choose a shorter one.")
    if given.suffix == JOURNAL:
        return given.with_suffix(".yaml")
    if given.suffix in (".yaml", ".yml"):
        return given
    return given.with_name(f"{given.name}.yaml")


def new_session(given: Path | None, folder: Path) -> Path:
    """The file for a new session: as given, or in the folder `session.yaml`, `session-2.yaml` …

    Raises:
        UsageError: the file exists, or an unfinished session is there.
    """
    if given is None:
        waiting = unfinished(folder)
        if waiting:
            raise UsageError(
                f"There is an unfinished session here: {', '.join(path.name for path in waiting)}.",
                "Continue with --resume, or name a file for a new one: orthocal measure NAME.yaml",
            )
        names = chain(("session.yaml",), (f"session-{number}.yaml" for number in count(2)))
        return next(folder / name for name in names if not (folder / name).exists())
    path = session_path(given)
    if path.exists():
        raise UsageError(
            f"{path} exists; a session is never overwritten.",
            "Name another file, or continue an unfinished session with --resume.",
        )
    if journal_path(path).exists():
        raise UsageError(
            f"{journal_path(path)} holds a session that is not finished.",
            f"Continue it: {command('measure', str(path), options='--resume')}",
        )
    return path


def resumed_session(given: Path | None, folder: Path) -> Path:
    """The file of the session to go on with; without a name the only unfinished one here."""
    if given is not None:
        return session_path(given)
    waiting = unfinished(folder)
    if not waiting:
        raise UsageError(
            "There is no unfinished session in this folder.",
            "Name its file: orthocal measure NAME.yaml --resume",
        )
    names = ", ".join(path.name for path in waiting)
    if len(waiting) > 1:
        raise UsageError(
            f"There are {len(waiting)} unfinished sessions here: {names}.",
            "Name one: orthocal measure NAME.yaml --resume",
        )
    return waiting[0].with_suffix(".yaml")


def unfinished(folder: Path) -> list[Path]:
    """Journals without a session file, in alphabetical order."""
    journals = folder.glob(f"*{JOURNAL}")
    return sorted(path for path in journals if not path.with_suffix(".yaml").exists())


def session_values(so_far: ReadingsSoFar) -> Session:
    """The session file's content; the same records always give the same."""
    state, setting, first = so_far.state, so_far.setting, so_far.setting.first
    opened, resolution = state.opened, setting.machine.gauge.resolution_mm
    gauges = [
        GaugeIdentity(id=gauge.id, certificate=gauge.certificate, resolution_mm=resolution)
        for gauge in opened.gauges
    ]
    before = first.conditions.gauges if first else ()
    return Session(
        machine=setting.model,
        protocol=opened.protocol.value,
        operator=opened.operator or (first.conditions.operator if first else None),
        gauges=(*gauges, *(each for each in before if each.id not in {g.id for g in gauges})),
        started=(first.conditions.started if first else None) or opened.at,
        finished=state.ended.at if state.ended else None,
        environment=_environment(state, first),
        readings=(*(first.rows if first else ()), *so_far.rows),
        retaken=tuple(so_far.row(old.take, reason=old.reason) for old in state.replaced),
        skipped=tuple(
            so_far.place(number).model_copy(update={"reason": reason})
            for number, reason in sorted(state.skipped.items())
        ),
    )


def written_before(so_far: ReadingsSoFar) -> set[bytes]:
    """The session files that this session wrote whenever it was ended and then reopened."""
    written, before = set(), so_far.state.reopened
    while before is not None:
        written.add(session_text(session_values(ReadingsSoFar(before, so_far.setting))).encode())
        before = before.reopened
    return written


def _environment(state: State, first: PriorReadings | None) -> dict[str, str]:
    opened = state.opened
    said = first.environment if first else {}
    said["readings_from"] = ", ".join(state.source)
    if opened.seed is not None:
        said["seed"] = str(opened.seed)
    if opened.temperature_c is not None:
        said["temperature_c"] = f"{opened.temperature_c:g}"
    loose = [
        f"step {number}: {text}" for number, text in state.notes if number not in state.accepted
    ]
    if loose:
        said["notes"] = "; ".join(loose)
    return said
