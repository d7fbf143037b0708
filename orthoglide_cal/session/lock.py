"""An exclusive lock on an open file; the system releases it when the process ends, however."""

from __future__ import annotations

import sys
from pathlib import Path

from orthoglide_cal.errors import UsageError

if sys.platform == "win32":
    import msvcrt

    def _try_lock(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    def _try_lock(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def lock(descriptor: int, path: Path) -> None:
    """Take the lock, or say who has it.

    Raises:
        UsageError: another process holds it.
    """
    try:
        _try_lock(descriptor)
    except OSError as error:
        raise UsageError(
            f"{path} is in use by another session that is still running.",
            "Go on there, or end it there with q.",
        ) from error
