"""A file's text, read and written."""

import codecs
import csv
import hashlib
import io
import os
import re
import shutil
import stat
import sys
import time
import uuid
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain, count
from pathlib import Path
from typing import Annotated

from pydantic import Field

from orthoglide_cal.errors import InputError, UsageError, system_words, visible
from orthoglide_cal.files import moonraker
from orthoglide_cal.model.measured import Source

_LARGEST = 50_000_000  # bytes

# Without tab and line ends: the next message would bring them to the terminal as escape sequences.
CONTROL = re.compile("[\x01-\x08\x0e-\x1f\x7f-\x84\x86-\x9f]")
# A temporary file of `write_text`, and the age at which it was left behind [s].
_LEFT = re.compile(r"\..+\.[0-9a-f]{12}\.tmp")
_ABANDONED_S = 3600.0
_FORMULA = tuple("=+-@\t\r\n")  # what a spreadsheet would calculate
_UTF8 = "Save it as UTF-8 (in a spreadsheet: “CSV UTF-8”)."
_GIVE = "Give a CSV, a session, or a printer's file, saved as UTF-8 text."


@dataclass(frozen=True)
class FileText:
    """A text file as read; line ends are "\\n", and there is no byte order mark."""

    path: str  # as the user gave it; "-" for standard input
    text: str
    marked: bool  # with a byte order mark
    sha256: str  # hex digest of what was read
    # What was read; empty in a journal, which holds the text.
    data: Annotated[bytes, Field(exclude=True)] = field(default=b"", compare=False, repr=False)

    @property
    def source(self) -> Source:
        return Source(self.path, self.sha256)

    def beside(self, name: str) -> "FileText | None":
        """The file of this name in the same folder; None if there is none. Raises InputError."""
        path = Path(self.path).with_name(name)
        return read_document(str(path)) if self.path != "-" and path.is_file() else None


def read_document(path: str) -> FileText:
    """Read a text file, or standard input for "-".

    Raises InputError: no such file, a folder, no permission; too large, empty, or no UTF-8 text.
    """
    return document_from_bytes(read_bytes(path), path)


def read_bytes(path: str) -> bytes:
    """The bytes of a file, of standard input ("-"), or of the printer.cfg of a Moonraker server.

    Raises InputError: no such file, a folder, no permission; the server cannot be reached.
    """
    if address := moonraker.server(path):
        return moonraker.printer_cfg(address)
    try:
        if path == "-":
            return sys.stdin.buffer.read(_LARGEST + 1)
        with Path(path).open("rb") as file:
            return file.read(_LARGEST + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the path
        fault = f"The file cannot be read: {system_words(error)}."
        remedy = "Check the path and its permissions."
        if isinstance(error, FileNotFoundError):
            fault, remedy = "There is no such file.", "Check the path."
        elif isinstance(error, IsADirectoryError):
            fault, remedy = "This is a folder.", "Name a file inside it."
        raise InputError(fault, remedy, file=path) from error


def document_from_bytes(data: bytes, path: str) -> FileText:
    """The text of `data`. Raises InputError as `read_document` does."""

    def refused(
        fault: str, remedy: str, at: int | None = None, value: str | None = None
    ) -> InputError:
        line = None if at is None else len((data[:at] + b".").splitlines())
        return InputError(fault, remedy, file=path, line=line, value=value)

    check_size(len(data), path, _LARGEST)
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise refused("The text is encoded as UTF-16.", _UTF8, 0)
    if data.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        fault = "This is a spreadsheet or an archive, not text."
        raise refused(fault, "Save the sheet as CSV (UTF-8) and give that file.")
    if b"\0" in data:
        fault = "This is no text file, or a damaged one: it holds a NUL byte."
        raise refused(fault, _GIVE, data.index(b"\0"))
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        if CONTROL.search(data.decode("ascii", "ignore")):
            raise refused("This is no text file.", _GIVE) from error
        fault, value = "The text is not UTF-8 (Latin-1 or a Windows code page?).", data[error.start]
        raise refused(fault, _UTF8, error.start, f"byte 0x{value:02X}") from error
    if control := CONTROL.search(text):
        fault, remedy = "The text holds a control character.", "Remove it; a file is plain text."
        raise refused(fault, remedy, data.index(control[0].encode()), control[0])
    text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    if not text.strip():
        raise refused("The file is empty.", "Give another, or restore a copy.")
    marked, sha256 = data.startswith(codecs.BOM_UTF8), hashlib.sha256(data).hexdigest()
    return FileText(path, text, marked, sha256, data)


def check_size(size: int, path: str, limit: int) -> None:
    """Raise InputError if `size` bytes are more than `limit`."""
    if size > limit:
        fault = f"The file is larger than {limit // 1_000_000} MB, the most that is read."
        remedy = "Check that this is the right file; a session of an hour has a few kilobytes."
        raise InputError(fault, remedy, file=path)


def write_text(path: Path, text: str | bytes, *, overwrite: bool = False) -> None:
    """Write a file, in UTF-8, through a temporary one beside it, synchronised to the disk.

    A file that is replaced keeps its owner and mode. Raises UsageError: the file exists, and not
    `overwrite`; InputError: it has several names, or cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.tmp")
    # Temporary files of interrupted writes: those that nobody can be writing, and names of `path`.
    for left in filter(lambda left: _LEFT.fullmatch(left.name), path.parent.glob(".*.tmp")):
        with suppress(OSError):
            if time.time() - left.stat().st_mtime > _ABANDONED_S or left.samefile(path):
                left.unlink()
    try:
        replaces = path.exists()
        if replaces and not overwrite:
            raise FileExistsError
        check_writable(path)
        with temporary.open("xb") as file:
            file.write(text if isinstance(text, bytes) else text.encode())
            file.flush()
            os.fsync(file.fileno())
        if replaces:
            _keep_owner(path, temporary)
            shutil.copymode(path, temporary)
        if overwrite:
            temporary.replace(path)
        else:
            _publish(temporary, path)
        with suppress(OSError):  # a new name survives a power loss; Windows keeps a journal of them
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    except FileExistsError as error:
        remedy = "Name another file, or move that one away."
        raise UsageError(f"{path} exists and is not overwritten.", remedy) from error
    except OSError as error:
        fault = f"The file cannot be written: {system_words(error)}."
        remedy = "Check the folder, its permissions and the free space."
        raise InputError(fault, remedy, file=str(path)) from error
    finally:
        with suppress(OSError):  # a folder that cannot be written to says so above
            temporary.unlink(missing_ok=True)


def _keep_owner(path: Path, other: Path) -> None:
    """Give another file the owner and group of `path`. Raises OSError if nobody may."""
    wanted, stands = path.stat(), other.stat()
    if (wanted.st_uid, wanted.st_gid) != (stands.st_uid, stands.st_gid):
        try:
            os.chown(other, wanted.st_uid, wanted.st_gid)
        except PermissionError as error:
            raise PermissionError(error.errno, "it belongs to another user or group") from error


def _publish(temporary: Path, path: Path) -> None:
    """Give a finished file its name. Raises FileExistsError if another file has it."""
    try:
        path.hardlink_to(temporary)  # fails where a rename would replace
    except FileExistsError:
        raise
    except OSError:  # a file system without links (USB sticks)
        if path.exists():
            raise FileExistsError(str(path)) from None
        temporary.rename(path)


def check_writable(path: Path) -> None:
    """Raise InputError for a file that is read-only or has other names, or a read-only folder."""
    known = path.stat() if path.exists() else None
    if known and not known.st_mode & stat.S_IWUSR:
        problem, remedy = "The file is read-only.", "Make it writable, or ask its owner."
    elif known and known.st_nlink > 1:
        problem = "The file has other names (hard links), which would keep the old content."
        remedy = f"Remove them; to list them: find FOLDER -samefile {path.name}"
    elif path.parent.is_dir() and not os.access(path.parent, os.W_OK):
        problem, remedy = "Its folder is read-only.", "Make the folder writable, or ask its owner."
    else:
        return
    raise InputError(problem, remedy, file=str(path))


def free_path(folder: Path, stem: str, suffix: str, *others: str) -> Path:
    """The first of stem, stem-2, … that no file with one of the suffixes has; with the first."""
    stems = chain((stem,), (f"{stem}-{number}" for number in count(2)))
    paths, ends = (folder / f"{name}{suffix}" for name in stems), (suffix, *others)
    return next(p for p in paths if not any(p.with_suffix(end).exists() for end in ends))


def number_text(value: float) -> str:
    """The shortest text that reads back as exactly `value`: 60 for 60.0, 0.1 for 0.1."""
    return repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(float(value))


def csv_text(head: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    """A header line and one line for each row; None is an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()


def in_csv(text: str) -> str:
    """The text for a cell of a CSV; a formula gets a "'" in front, and so would a number."""
    dangerous = text.startswith(_FORMULA) or text.lstrip().startswith(("=", "+", "-", "@"))
    return ("'" if dangerous else "") + visible(text)
