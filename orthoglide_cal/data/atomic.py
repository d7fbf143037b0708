"""Writing a file so that it is either not there or complete, whatever happens in between."""

from __future__ import annotations

import os
import uuid
from pathlib import Path

from orthoglide_cal.errors import InputError, UsageError


def write_text(path: Path, text: str, *, overwrite: bool = False) -> None:
    """Write UTF-8 text to `path` through a temporary file beside it, synchronised to the disk.

    Args:
        path: the file's final place.
        text: its content.
        overwrite: replace an existing file; otherwise it is left alone.

    Raises:
        UsageError: the file exists and may not be replaced.
        InputError: the file cannot be written (no such folder, no permission, disk full).
    """
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.tmp")
    try:
        if not overwrite and path.exists():
            raise FileExistsError
        with temporary.open("x", encoding="utf-8", newline="\n") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        if overwrite:
            temporary.replace(path)
        else:
            _publish(temporary, path)
        _sync_folder(path.parent)
    except FileExistsError as error:
        raise UsageError(
            f"{path} exists and is not overwritten.", "Name another file, or move that one away."
        ) from error
    except OSError as error:
        raise InputError(
            f"The file cannot be written: {error.strerror or error}.",
            "Check the folder, its permissions and the free space.",
            file=str(path),
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def _publish(temporary: Path, path: Path) -> None:
    """Give the finished file its name unless something has it; a link fails where a rename would
    replace. File systems without links (USB sticks) get a check and a rename."""
    try:
        path.hardlink_to(temporary)
    except FileExistsError:
        raise
    except OSError:
        if path.exists():
            raise FileExistsError(str(path)) from None
        temporary.rename(path)


def _sync_folder(folder: Path) -> None:
    """Make the new name survive a power loss, where the system lets a folder be opened."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError:
        pass
    finally:
        os.close(handle)
