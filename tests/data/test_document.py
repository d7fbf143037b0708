"""Bytes to text: sizes, encodings, standard input."""

import hashlib
import io
import sys

import pytest

from orthoglide_cal.data.document import UnreadableError, document_from_bytes, read_document
from orthoglide_cal.errors import InputError


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
        (b"PK\x03\x04rest", "spreadsheet", None),
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
    with pytest.raises(UnreadableError, match="no such file"):
        read_document(str(tmp_path / "none.csv"))
    with pytest.raises(UnreadableError, match="folder"):
        read_document(str(tmp_path))
    with pytest.raises(UnreadableError, match="cannot be read"):
        read_document("a\0b")


def test_too_large_is_not_read_to_its_end(tmp_path):
    path = tmp_path / "large.csv"
    with path.open("wb") as file:
        file.truncate(10**12)  # sparse
    with pytest.raises(InputError, match="larger than 50 MB"):
        read_document(str(path))


def test_standard_input(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"a\n")))
    read = read_document("-")
    assert (read.path, read.text) == ("-", "a\n")
