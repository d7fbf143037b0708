"""The journal: an append-only file that holds everything that was acknowledged, always.

One record per line, `{"crc32":"…","record":{…}}`. The checksum runs over all records up to this
one, so that a record that was cut, altered, removed or moved is noticed. A record counts from the
moment its bytes are on the disk (fsync); what a power loss left of an unfinished last record is
ignored and reported.
"""

import json
import os
import re
import zlib
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from io import BytesIO, FileIO
from pathlib import Path

from pydantic import ValidationError

from orthoglide_cal.errors import InputError, UsageError, command
from orthoglide_cal.files.text import write_text
from orthoglide_cal.session.events import RECORD, Event, Opened
from orthoglide_cal.system import SYSTEM

_BEGIN = b'{"crc32":"'
_LINE = re.compile(_BEGIN + rb'(.*?)","record":(.*)\}', re.DOTALL)


def encode(event: Event, checksum: int = 0) -> tuple[bytes, int]:
    """One line for `event` after records with this running checksum; and the new checksum."""
    body = json.dumps(event.model_dump(), ensure_ascii=True, separators=(",", ":")).encode()
    checksum = zlib.crc32(body, checksum)
    return b'{"crc32":"%08x","record":%s}\n' % (checksum, body), checksum


def create(path: Path, *events: Event) -> None:
    """Write a new journal of these records, all or none. Raises UsageError if the file exists."""
    data, checksum = b"", 0
    for event in events:
        line, checksum = encode(event, checksum)
        data += line
    write_text(path, data)


@dataclass(eq=False)
class Journal:
    """A journal as it was read; `resume` opens and locks it against every other session."""

    path: Path
    events: tuple[Event, ...]  # that were read, the first one `Opened`
    lost: int  # number of bytes after them that were no complete record
    _checksum: int  # of the records on the disk
    _size: int  # length of their bytes on the disk
    _file_size: int  # with what a power loss left behind them
    _end: bytes  # that the last record lacks
    _descriptor: int = -1

    @classmethod
    def resume(cls, path: Path, opened: ExitStack) -> "Journal":
        """The journal in `path`, to be continued; its lock ends with what is `opened`.

        Raises UsageError: there is none, or another session is using it; InputError: it cannot be
        read, or is damaged.
        """
        try:
            file = opened.enter_context(FileIO(path, "r+"))
        except FileNotFoundError as error:
            fault = f"There is no unfinished session in {path}."
            raise UsageError(fault, "Leave out --resume to begin one.") from error
        except OSError as error:
            raise InputError(
                f"The journal cannot be opened: {error.strerror}.",
                "Check the folder and its permissions.",
                file=str(path),
            ) from error
        try:  # the system releases it when the process ends, however
            SYSTEM.lock(file.fileno())
        except OSError as error:
            raise UsageError(
                f"{path} is in use by another session that is still running.",
                "Continue there (fg, if it was stopped with Ctrl-Z), or end it there with q.",
            ) from error
        return replace(decode(file.read(), path), _descriptor=file.fileno())

    def append(self, event: Event) -> None:
        """Put a record on the disk; returns when it is safe.

        Raises InputError if the disk is full or the file is gone; nothing of the record remains.
        """
        line, checksum = encode(event, self._checksum)
        line = self._end + line
        try:
            mine = os.fstat(self._descriptor)
            if not os.path.samestat(mine, os.stat(self.path)):
                raise OSError("another file has its name now")
            if mine.st_size != self._file_size:
                raise OSError("another program changed it")
            os.ftruncate(self._descriptor, self._size)
            self._file_size = self._size
            os.lseek(self._descriptor, self._size, os.SEEK_SET)
            rest = memoryview(line)
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
            os.fsync(self._descriptor)
        except OSError as error:
            # Remove what was written of it; if even that fails, the next resume ignores it.
            with suppress(OSError):
                if os.fstat(self._descriptor).st_size > self._size == self._file_size:
                    os.ftruncate(self._descriptor, self._size)
                    os.fsync(self._descriptor)
            raise InputError(
                f"The last entry could not be saved: {error.strerror or error}.",
                "The readings so far are safe. Free some space, or plug the drive in again; then:"
                f" {command('measure', str(self.path.with_suffix('.yaml')), options='--resume')}",
                file=str(self.path),
            ) from error
        self._size = self._file_size = self._size + len(line)
        self._checksum, self._end = checksum, b""


def decode(data: bytes, path: str | Path) -> Journal:
    """The journal that these bytes are; it cannot be continued.

    Raises InputError if there is none, or it is damaged before its last record.
    """
    events: list[Event] = []
    checksum, size = 0, 0
    for number, line in enumerate(BytesIO(data), start=1):
        try:
            event, after = _decode_line(line.rstrip(b"\n"), checksum)
        except ValueError as error:
            rest = data[size + len(line) :].strip(b"\0\n")
            if number > 1 and not rest and line.count(_BEGIN) <= 1:
                break
            fault = f"The journal is damaged here: {error}."
            remedy = "Restore the file from a copy; or resume a copy of the lines above this one."
            if isinstance(error.__cause__, ValidationError):
                remedy = "Use the orthocal that wrote it, or restore the file from a copy."
            elif number == 1:
                fault = "This is not the journal of a session."
                remedy = "Restore the file from a copy, or begin a new session."
            raise InputError(fault, remedy, file=str(path), line=number) from error
        events.append(event)
        checksum = after
        size += len(line)
    if not events or not isinstance(events[0], Opened):
        raise InputError("The journal is empty.", "Begin a new session.", file=str(path))
    end = b"" if data[:size].endswith(b"\n") else b"\n"
    lost = len(data) - size
    return Journal(Path(path), tuple(events), lost, checksum, size, len(data), end)


def _decode_line(line: bytes, checksum: int) -> tuple[Event, int]:
    match, step = _LINE.fullmatch(line), re.search(rb'"step":([0-9]+)', line)
    entry = f"the entry of step {int(step[1])}" if step else "an entry"
    if match is None:
        raise ValueError(f"{entry} is cut off or altered")
    after = zlib.crc32(match[2], checksum)
    if match[1] != b"%08x" % after:
        raise ValueError(f"{entry} does not match its checksum")
    try:
        return RECORD.validate_json(match[2]), after
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(map(str, fault["loc"]))
        raise ValueError(f"{where or entry} is not as this version writes it") from error
