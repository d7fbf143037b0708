"""Shared by the tests of files: text in, faults out."""

from pathlib import Path
from typing import Any

import yaml

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.machine_file import default_machine
from orthoglide_cal.files.text import FileText, document_from_bytes
from orthoglide_cal.model.measured import Differences, Measured, Readings

MODEL = default_machine()
MACHINE = MODEL.machine
PROTOTYPE = Path(__file__).parents[2] / "configs" / "orthoglide_prototype.yaml"


def parsed(text: str) -> Any:
    """Content of YAML, by the fast loader where there is one."""
    return yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def table(name: str) -> Any:
    """Cases for tests, from a file beside them."""
    return parsed(Path(__file__).with_name(name).read_text(encoding="utf-8"))


VARIANTS = table("variants.yaml")


def replaced(text: str, pairs: dict[str, str]) -> str:
    for old, new in pairs.items():
        assert old in text
        text = text.replace(old, new)
    return text


def document(text: str, path: str = "data.csv") -> FileText:
    return document_from_bytes(text.encode(), path)


def saved(folder: Path, text: str, name: str = "data.csv") -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


def measured(folder: Path, text: str) -> Measured:
    return read_input(saved(folder, text, "data.csv"), MODEL).measured


def readings(folder: Path, text: str) -> Readings:
    result = measured(folder, text)
    assert isinstance(result, Readings)
    return result


def differences(folder: Path, text: str) -> Differences:
    result = measured(folder, text)
    assert isinstance(result, Differences)
    return result


def problems(call, *args) -> list[InputError]:
    try:
        call(*args)
    except InputError as error:
        return list(error.problems)
    raise AssertionError("nothing was wrong")


def places(faults: list[InputError]) -> list[tuple[int | None, str | None, str | None]]:
    return [(fault.line, fault.column, fault.value) for fault in faults]
