"""Reading and writing machine files; finding the one that comes with the package."""

from __future__ import annotations

import functools
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from orthoglide_cal.data.atomic import write_text
from orthoglide_cal.data.document import YAML_LIMIT, Document, document_from_bytes, read_document
from orthoglide_cal.data.machine_schema import MachineModel
from orthoglide_cal.data.schema import check_tree
from orthoglide_cal.data.yaml_tree import Tree, load_tree
from orthoglide_cal.errors import InputError
from orthoglide_cal.machine import Machine

DEFAULT_NAME = "orthoglide_prototype.yaml"

_DUMPER: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


def read_machine(path: Path | str | None = None) -> Machine:
    """The machine described by a file, or the prototype for None.

    Args:
        path: machine file; "-" is standard input.

    Raises:
        InvalidFileError: everything in it that breaks the schema, each with line and path.
        InputError: not readable, not YAML, or not a machine file.
    """
    if path is None:
        return default_machine()
    return machine_from_tree(load_tree(read_document(str(path), YAML_LIMIT)))


@functools.cache
def default_machine() -> Machine:
    """The paper's prototype, from the file that comes with the package."""
    return machine_from_tree(load_tree(_default_document()))


def machine_from_tree(tree: Tree) -> Machine:
    """The machine that a parsed file describes. Raises as `read_machine` does."""
    value = tree.value
    if not isinstance(value, dict):
        raise InputError(
            "This is not a machine file.",
            f"Copy configs/{DEFAULT_NAME} and change its values.",
            file=tree.document.path,
            line=1,
        )
    if "readings" in value and "machine" in value:
        raise InputError(
            "This is a session, not a machine file.",
            "Give it as the input; the machine that it was measured on is inside.",
            file=tree.document.path,
        )
    return check_tree(MachineModel, tree).to_machine()


def write_machine(machine: Machine, path: Path | str) -> None:
    """Write a machine file (without comments); an existing file is never touched.

    Raises:
        UsageError: the file exists.
        InputError: the folder cannot be written to.
    """
    write_text(Path(path), machine_text(machine))


def machine_text(machine: Machine) -> str:
    """The machine file's text; `read_machine` gives back an equal machine."""
    return yaml_text(MachineModel.from_machine(machine).model_dump())


def yaml_text(value: Any) -> str:
    """YAML of plain values, in the order given, as `load_tree` reads it back."""
    text: str = yaml.dump(
        value,
        sort_keys=False,
        allow_unicode=True,
        width=1000,
        default_flow_style=None,
        Dumper=_DUMPER,
    )
    return text


def _default_document() -> Document:
    """In a wheel the file lies inside the package, in a source checkout beside it."""
    package = files("orthoglide_cal")
    inside = package / "configs" / DEFAULT_NAME
    if inside.is_file():
        return document_from_bytes(inside.read_bytes(), f"configs/{DEFAULT_NAME}")
    return read_document(str(Path(str(package)).parent / "configs" / DEFAULT_NAME))
