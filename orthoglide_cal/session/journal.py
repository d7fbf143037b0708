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
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from pydantic import ValidationError

from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.files.text import write_text
from orthoglide_cal.session.events import RECORD, Event, Opened
from orthoglide_cal.system import SYSTEM

_BEGIN = b'{"crc32":"'
_LINE = re.compile(_BEGIN + rb'(.*?)","record":(.*)\}', re.DOTALL)


@dataclass(frozen=True)
class Recovered:
    """What a journal's bytes hold: complete records, the first one `Opened`."""

    events: tuple[Event, ...]
    size: int  # length of their bytes
    lost: int  # number of bytes after them that are no complete record
    open_line: bool  # True if only the line end of the last record is missing
    checksum: int  # running checksum after the last record


def encode(event: Event, checksum: int = 0) -> tuple[bytes, int]:
    """One line for `event` after records with this running checksum; and the new checksum."""
    body = json.dumps(event.model_dump(), ensure_ascii=True, separators=(",", ":")).encode()
    checksum = zlib.crc32(body, checksum)
    return b'{"crc32":"%08x","record":%s}\n' % (checksum, body), checksum


def decode(data: bytes, path: str) -> Recovered:
    """The records in a journal's bytes.

    Raises InputError if it is none, or damaged before its last record.
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
            what = f"The journal is damaged here: {error}."
            remedy = "Restore the file from a copy; or resume a copy of the lines above this one."
            if isinstance(error.__cause__, ValidationError):
                remedy = "Use the orthocal that wrote it, or restore the file from a copy."
            elif number == 1:
                what = "This is not the journal of a session."
                remedy = "Name the session file, such as session.yaml."
            raise InputError(what, remedy, file=path, line=number) from error
        events.append(event)
        checksum = after
        size += len(line)
    if not events or not isinstance(events[0], Opened):
        raise InputError("The journal is empty.", "Begin a new session.", file=path)
    open_line = not data[:size].endswith(b"\n")
    return Recovered(tuple(events), size, len(data) - size, open_line, checksum)


def _decode_line(line: bytes, checksum: int) -> tuple[Event, int]:
    found = _LINE.fullmatch(line)
    if found is None:
        raise ValueError("not a record")
    after = zlib.crc32(found[2], checksum)
    if found[1] != b"%08x" % after:
        raise ValueError("the checksum does not match")
    try:
        return RECORD.validate_json(found[2]), after
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(map(str, fault["loc"]))
        raise ValueError(f"{where or 'the record'}: {fault['msg'].lower()}") from error


class Journal:
    """The journal of a running session, locked against every other session."""

    def __init__(self, path: Path, descriptor: int, recovered: Recovered) -> None:
        self.path = path
        self.recovered = recovered
        self._descriptor = descriptor
        self._size, self._checksum = recovered.size, recovered.checksum
        self._lost = recovered.lost  # bytes after the last complete record
        self._end = b"\n" if recovered.open_line else b""  # of the last record

    @classmethod
    def create(cls, path: Path, *events: Event) -> "Journal":
        """A new journal of these records, all or none. Raises UsageError if the file exists."""
        text, checksum = "", 0
        for event in events:
            line, checksum = encode(event, checksum)
            text += line.decode()
        write_text(path, text)
        return cls.resume(path)

    @classmethod
    def resume(cls, path: Path) -> "Journal":
        """The journal in `path`, to be continued.

        Raises UsageError: there is none, or another session is using it; InputError: it cannot be
        read, or is damaged.
        """
        try:
            descriptor = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
        except FileNotFoundError as error:
            what = f"There is no unfinished session in {path}."
            raise UsageError(what, "Leave out --resume to begin one.") from error
        except OSError as error:
            raise InputError(
                f"The journal cannot be opened: {error.strerror}.",
                "Check the folder and its permissions.",
                file=str(path),
            ) from error
        try:
            try:  # the system releases it when the process ends, however
                SYSTEM.lock(descriptor)
            except OSError as error:
                raise UsageError(
                    f"{path} is in use by another session that is still running.",
                    "Continue there (fg, if it was stopped with Ctrl-Z), or end it there with q.",
                ) from error
            with open(descriptor, "rb", closefd=False) as file:
                return cls(path, descriptor, decode(file.read(), str(path)))
        except BaseException:
            os.close(descriptor)
            raise

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
            if mine.st_size != self._size + self._lost:
                raise OSError("another program changed it")
            os.ftruncate(self._descriptor, self._size)
            self._lost = 0
            os.lseek(self._descriptor, self._size, os.SEEK_SET)
            rest = memoryview(line)
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
            os.fsync(self._descriptor)
        except OSError as error:
            # Remove what was written of it; if even that fails, the next resume ignores it.
            with suppress(OSError):
                if not self._lost and os.fstat(self._descriptor).st_size > self._size:
                    os.ftruncate(self._descriptor, self._size)
                    os.fsync(self._descriptor)
            raise InputError(
                f"The last entry could not be saved: {error.strerror or error}.",
                "All earlier entries are on the disk. Free some space, or plug the drive in again;"
                " then continue with --resume.",
                file=str(self.path),
            ) from error
        self._size += len(line)
        self._checksum, self._end = checksum, b""

    def close(self) -> None:
        """Let go of the file and its lock."""
        os.close(self._descriptor)
