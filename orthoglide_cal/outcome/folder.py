"""The sessions in a folder, recognised by their content."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from orthoglide_cal.data.document import YAML_LIMIT, read_document
from orthoglide_cal.errors import InputError

# Keys at the beginning of a line; parsing every file of a large folder would take seconds.
_KEY = re.compile(r"^(machine|readings|finished|started):[ \t]*(.*)$", re.MULTILINE)


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


def sessions_in(folder: Path) -> list[FoundSession]:
    """All session files of a folder, oldest first.

    Raises:
        InputError: there is no such folder.
    """
    if not folder.is_dir():
        raise InputError("There is no such folder.", "Check the path.", file=str(folder))
    candidates = (*folder.glob("*.yaml"), *folder.glob("*.yml"))
    found = (_look(path) for path in candidates if path.is_file())
    return sorted(session for session in found if session is not None)


def latest_session(folder: Path) -> Path:
    """The session that was finished last.

    Raises:
        InputError: there is none.
    """
    found = sessions_in(folder)
    if not found:
        raise InputError(
            "There is no session in this folder.",
            "Name a file of readings, or measure first: orthocal measure",
            file=str(folder),
        )
    return found[-1].path


def _look(path: Path) -> FoundSession | None:
    try:
        text = read_document(str(path), YAML_LIMIT).text
    except InputError:
        return None
    keys = dict(reversed(_KEY.findall(text)))
    if not {"machine", "readings"} <= keys.keys():
        return None
    for key in ("finished", "started"):
        try:
            written = keys.get(key, "").strip().strip("'\"")
            return FoundSession(datetime.fromisoformat(written).timestamp(), path, True)
        except ValueError:
            continue
    return FoundSession(path.stat().st_mtime, path, False)
