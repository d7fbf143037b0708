"""A file is complete or not there."""

import os
from pathlib import Path

import pytest

from orthoglide_cal.data import write_text
from orthoglide_cal.errors import InputError, UsageError


def test_written_once(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "grün\n")
    assert path.read_bytes() == "grün\n".encode()
    with pytest.raises(UsageError):
        write_text(path, "other")
    write_text(path, "other", overwrite=True)
    assert path.read_text() == "other"
    assert list(tmp_path.iterdir()) == [path]


def test_permissions_follow_the_umask(tmp_path):
    old = os.umask(0o022)
    try:
        write_text(tmp_path / "a", "x")
    finally:
        os.umask(old)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o644


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


def test_no_folder(tmp_path):
    with pytest.raises(InputError, match="cannot be written") as caught:
        write_text(tmp_path / "none" / "a", "x")
    assert caught.value.file.endswith("a")


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
