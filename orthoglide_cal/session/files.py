"""Which files a session lives in: `session.yaml` in the end, `session.journal` meanwhile."""

from __future__ import annotations

from pathlib import Path

from orthoglide_cal.data import SessionRecord, session_text, write_session
from orthoglide_cal.errors import UsageError

JOURNAL = ".journal"


def journal_path(session: Path) -> Path:
    """The journal beside a session file."""
    return session.with_suffix(JOURNAL)


def session_path(given: Path) -> Path:
    """The session file that is meant by a name, be it that of its journal or without a suffix."""
    if given.suffix == JOURNAL:
        return given.with_suffix(".yaml")
    if given.suffix in (".yaml", ".yml"):
        return given
    return given.with_name(f"{given.name}.yaml")


def new_session(given: Path | None, folder: Path) -> Path:
    """The file for a new session.

    Args:
        given: name from the command line; without one, `session.yaml` or the first free
            `session-2.yaml`, `session-3.yaml` …
        folder: where the latter goes.

    Raises:
        UsageError: the file exists, or an unfinished session is there.
    """
    if given is not None:
        path = session_path(given)
        _refuse_existing(path)
        return path
    waiting = unfinished(folder)
    if waiting:
        raise UsageError(
            f"There is an unfinished session here: {_names(waiting)}.",
            "Go on with --resume, or name a file for a new one: orthocal measure NAME.yaml",
        )
    number = 1
    while True:
        path = folder / ("session.yaml" if number == 1 else f"session-{number}.yaml")
        if not path.exists() and not journal_path(path).exists():
            return path
        number += 1


def resumed_session(given: Path | None, folder: Path) -> Path:
    """The file of the session to go on with; without a name the only unfinished one here.

    Raises:
        UsageError: there is none, or more than one.
    """
    if given is not None:
        return session_path(given)
    waiting = unfinished(folder)
    if not waiting:
        raise UsageError(
            "There is no unfinished session in this folder.",
            "Name its file: orthocal measure NAME.yaml --resume",
        )
    if len(waiting) > 1:
        raise UsageError(
            f"There are {len(waiting)} unfinished sessions here: {_names(waiting)}.",
            "Name one: orthocal measure NAME.yaml --resume",
        )
    return waiting[0].with_suffix(".yaml")


def unfinished(folder: Path) -> list[Path]:
    """Journals without a session file, in alphabetical order."""
    return sorted(
        path for path in folder.glob(f"*{JOURNAL}") if not path.with_suffix(".yaml").exists()
    )


def publish(record: SessionRecord, path: Path) -> None:
    """Write the session file; doing so again after an interruption changes nothing.

    Raises:
        UsageError: another file has the name.
        InputError: it cannot be written.
    """
    if path.exists() and path.read_bytes() == session_text(record).encode():
        return
    write_session(record, path)


def _refuse_existing(path: Path) -> None:
    if path.exists():
        raise UsageError(
            f"{path} exists; a session is never overwritten.",
            "Name another file, or go on with an unfinished session with --resume.",
        )
    if journal_path(path).exists():
        raise UsageError(
            f"{journal_path(path)} holds a session that is not finished.",
            f"Go on with it: orthocal measure {path} --resume",
        )


def _names(paths: list[Path]) -> str:
    return ", ".join(path.name for path in paths)
