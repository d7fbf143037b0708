"""The Windows side, with a stand-in for its C library; not a real Windows machine."""

import importlib
import io
import os
import sys
from collections import deque
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from orthoglide_cal import system
from orthoglide_cal.session.asking import Keyboard
from orthoglide_cal.session.events import Journal
from tests.session.virtual import answered, opened


class Msvcrt:
    """As the module of that name documents itself."""

    LK_NBLCK = 2

    def __init__(self, keys: str = "") -> None:
        self.keys = deque(keys)
        self.output = io.StringIO()
        self.locked: set[tuple[int, int]] = set()  # (file, byte)

    def kbhit(self) -> bool:
        return bool(self.keys)

    def getwch(self) -> str:
        return self.keys.popleft()

    def locking(self, fd: int, mode: int, nbytes: int, /) -> None:
        place = (os.fstat(fd).st_ino, os.lseek(fd, 0, os.SEEK_CUR))
        if place in self.locked:
            raise OSError(13, "Permission denied")
        self.locked.add(place)


def windows(monkeypatch: pytest.MonkeyPatch, msvcrt: Msvcrt) -> None:
    """A computer with Windows, on this C library."""
    monkeypatch.setitem(sys.modules, "msvcrt", msvcrt)
    monkeypatch.setattr("orthoglide_cal.system.WINDOWS", True)


def keyboard_of(monkeypatch: pytest.MonkeyPatch, msvcrt: Msvcrt) -> closing[Keyboard]:
    windows(monkeypatch, msvcrt)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("sys.stdin.fileno", lambda: 0, raising=False)
    return closing(Keyboard(msvcrt.output))


@pytest.mark.parametrize(
    ("keys", "lines"),
    [
        ("-0.64\r", ["-0.64"]),
        ("-0.64\t0.41\r\n", ["-0.64", "0.41"]),
        ("0.13\b2\r", ["0.12"]),
        ("\xe0H\x00;0.5\r", ["0.5"]),  # arrow up, F1
        ("n grün\r", ["n grün"]),
    ],
)
def test_lines_are_typed_and_corrected(
    keys: str, lines: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    msvcrt = Msvcrt(keys)
    with keyboard_of(monkeypatch, msvcrt) as keyboard:
        assert keyboard.live
        found = [keyboard.read(0.1) for _ in lines]
        assert [line.text for line in found if line] == lines
        assert keyboard.read(0.01) is None
    assert msvcrt.output.getvalue().count("\n") == len(lines)


def test_what_was_typed_before_a_prompt_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    msvcrt = Msvcrt("0.41\r")
    with keyboard_of(monkeypatch, msvcrt) as keyboard:
        line = keyboard.read(0.0)
        msvcrt.keys.extend("0.5")
        assert (line.text, msvcrt.output.getvalue()) == ("0.41", "")
        assert keyboard.read(0.01) is None
        assert (keyboard.partial, msvcrt.output.getvalue()) == ("0.5", "0.5")
        msvcrt.keys.extend("for nobody")
    assert not msvcrt.keys


def test_ctrl_c_and_ctrl_z(monkeypatch: pytest.MonkeyPatch) -> None:
    with keyboard_of(monkeypatch, Msvcrt("\x03")) as keyboard, pytest.raises(KeyboardInterrupt):
        keyboard.read(0.1)
    with keyboard_of(monkeypatch, Msvcrt("\x1a")) as keyboard, pytest.raises(EOFError):
        keyboard.read(0.1)


def test_a_journal_is_locked_far_behind_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from orthoglide_cal.errors import UsageError

    msvcrt = Msvcrt()
    windows(monkeypatch, msvcrt)
    path, stack = tmp_path / "s.journal", ExitStack()
    Journal.create(path, opened())
    Journal.resume(path, stack)
    ((_, byte),) = msvcrt.locked
    assert byte > 1_000_000_000 > path.stat().st_size
    with pytest.raises(UsageError, match="in use by another session"):
        Journal.resume(path, stack)
    stack.close()
    msvcrt.locked.clear()  # as closing does
    dialogue, _ = answered(path, ["-0.64"])
    assert list(dialogue.state.accepted) == [1]


def test_windows_lacks_what_others_have(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "win32")
    for name in ("fcntl", "termios"):
        monkeypatch.setitem(sys.modules, name, None)
    chosen = importlib.reload(system).WINDOWS
    monkeypatch.undo()
    assert chosen > importlib.reload(system).WINDOWS
