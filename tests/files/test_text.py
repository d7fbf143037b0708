"""Bytes to text and back (sizes, encodings, complete or not there)."""

import hashlib
import os
import time
from pathlib import Path

import pytest

from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.files.text import document_from_bytes, read_document, write_text


def test_bom_and_line_ends():
    data = "\ufeffa,b\r\nc,d\re,f\n".encode()
    read = document_from_bytes(data, "x")
    assert read.text == "a,b\nc,d\ne,f\n"
    assert read.sha256 == hashlib.sha256(data).hexdigest()


@pytest.mark.parametrize(
    ("data", "what", "line"),
    [
        ("leg\n".encode("utf-16"), "UTF-16", 1),
        (b"leg\r\nx\0y\n", "NUL", 2),
        ("leg\n\nµ\n".encode("latin-1"), "not UTF-8", 3),
        (b"\xef\xbb\xbfa\n\xe4\n", "not UTF-8.*byte 0xE4", 2),
        (b"PK\x03\x04rest", "spreadsheet", None),
        (b"\x89PNG\r\n\x1a\nIHDR", "no text file", None),
        (b"", "empty", None),
        (b" \n\n", "empty", None),
        (b"a\nb\x1b[31m\n", "control character", 2),
    ],
)
def test_refused_with_a_remedy(data, what, line):
    with pytest.raises(InputError, match=what) as caught:
        document_from_bytes(data, "f.csv")
    assert (caught.value.file, caught.value.line) == ("f.csv", line)
    assert caught.value.remedy


def test_unreadable(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_document(str(tmp_path / "none.csv"))
    with pytest.raises(InputError, match="folder"):
        read_document(str(tmp_path))
    with pytest.raises(InputError, match="cannot be read"):
        read_document("a\0b")


def test_too_large_is_not_read_to_its_end(tmp_path):
    path = tmp_path / "large.csv"
    with path.open("wb") as file:
        file.truncate(10**12)  # sparse
    with pytest.raises(InputError, match="larger than 50 MB"):
        read_document(str(path))


def test_written_once(tmp_path):
    path, old = tmp_path / "a.txt", os.umask(0o022)
    try:
        write_text(path, "grün\n")
    finally:
        os.umask(old)
    assert path.stat().st_mode & 0o777 == 0o644
    assert path.read_bytes() == "grün\n".encode()
    with pytest.raises(UsageError):
        write_text(path, "other")
    write_text(path, "other", overwrite=True)
    assert path.read_text() == "other"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(InputError, match="cannot be written") as caught:
        write_text(tmp_path / "none" / "a", "x")
    assert caught.value.file.endswith("a")


def test_a_failure_leaves_nothing_behind(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    path.write_text("before")

    def full(handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="No space left"):
        write_text(path, "after", overwrite=True)
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_appears_meanwhile_is_kept(tmp_path, monkeypatch):
    path = tmp_path / "a"
    path.write_text("theirs")
    monkeypatch.setattr(Path, "exists", lambda self: False)
    with pytest.raises(UsageError):
        write_text(path, "mine")
    assert path.read_text() == "theirs"


def test_a_file_system_without_links(tmp_path, monkeypatch):
    def refused(self, target):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "hardlink_to", refused)
    write_text(tmp_path / "a", "x")
    assert (tmp_path / "a").read_text() == "x"
    with pytest.raises(UsageError):
        write_text(tmp_path / "a", "y")
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_what_an_interrupted_write_left_goes_once_nobody_can_be_writing_it(tmp_path):
    old, new = (tmp_path / f".b.0123456789a{end}.tmp" for end in "bc")
    for path, age_s in ((old, 3700.0), (new, 3500.0)):
        path.touch()
        os.utime(path, (time.time() - age_s,) * 2)
    write_text(tmp_path / "a", "x")
    assert [path.exists() for path in (old, new)] == [False, True]


def test_owner_mode_and_names_stay_or_it_is_refused(tmp_path, monkeypatch):
    path, other = tmp_path / "a.ini", tmp_path / "b.ini"
    path.write_text("before")
    path.chmod(0o640)
    other.hardlink_to(path)
    with pytest.raises(InputError, match="hard links"):
        write_text(path, "after", overwrite=True)
    assert other.read_text() == "before"
    other.unlink()
    # A write that was killed between its two last steps leaves a second name, which is none.
    (tmp_path / ".a.ini.0123456789ab.tmp").hardlink_to(path)
    wanted = path.stat()
    if os.getuid() == 0:
        os.chown(path, 4321, 1234)
        wanted = path.stat()
    write_text(path, "after", overwrite=True)
    assert (path.stat().st_uid, path.stat().st_gid) == (wanted.st_uid, wanted.st_gid)
    assert (path.stat().st_mode, path.read_text()) == (wanted.st_mode, "after")
    assert [path.name for path in tmp_path.iterdir()] == ["a.ini"]

    def may_not(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "chown", may_not)
    now = path.stat()
    other_group = os.stat_result((*now[:5], now.st_gid + 1, *now[6:]))
    monkeypatch.setattr(Path, "stat", lambda self, **_: other_group if self == path else now)
    with pytest.raises(InputError, match="another user or group"):
        write_text(path, "later", overwrite=True)
