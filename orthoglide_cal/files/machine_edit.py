"""Machine files that people keep: begun from the shipped one, and changed where they stand.

Comments, order and blanks stay as they are; what was written is always read back before it counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from orthoglide_cal.errors import InputError, InvalidFileError
from orthoglide_cal.files.machine_file import (
    WRITTEN,
    StoredMachine,
    machine_from_text,
    machine_text,
    machine_values,
    shipped_machine,
)
from orthoglide_cal.files.text import read_document
from orthoglide_cal.files.yaml_edit import edited
from orthoglide_cal.model import Entered
from orthoglide_cal.model.machine import JointOffsets

_HEAD = (
    WRITTEN
    + """\
# Change what you know better; `orthocal validate` checks it. Lengths are mm.
"""
)


def with_history(file: StoredMachine, offsets_mm: tuple[float, ...], *history: Entered) -> str:
    """The file's text with other active offsets [mm] and another history."""
    held = JointOffsets(*offsets_mm)
    machine = file.model.machine.changed(offsets_mm=held, history=history)
    model = replace(file.model, machine=machine)
    values = machine_values(model)
    text = edited(file.document.text, {key: values[key] for key in ("offsets_mm", "history")})
    try:
        same = machine_values(machine_from_text(text, file.document.path)) == values
    except InputError:
        same = False
    # JSON and other rare forms of YAML have no comments to lose.
    return text if same else machine_text(model)


def new_machine(values: Mapping[str, Any], path: str) -> str:
    """The text of a machine file with these values; the others are the shipped one's of its kind.

    Args:
        values: key → plain value, as in `machine_values`; without a kind it is an Orthoglide.
        path: name of the file, for messages.

    Raises:
        InvalidFileError: the values do not make a machine; each with its key.
    """
    prototype = read_document(str(shipped_machine(str(values.get("kind"))))).text
    shipped = prototype[prototype.index("schema_version:") :]
    text = edited(_HEAD + shipped, {**values, "history": [], "complete": True})
    try:
        machine_from_text(text, path)
    except InvalidFileError as error:
        # The file is not there yet: its lines say nothing.
        faults = error.problems
        raise InvalidFileError(
            [InputError(f.what, f.remedy, column=f.column, value=f.value) for f in faults]
        ) from error
    return text
