"""`orthocal template`: a filled-in example of a file, to be written over with one's own numbers."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer


class Example(StrEnum):
    """What kind of file."""

    READINGS = "readings"
    DIFFERENCES = "differences"
    MACHINE = "machine"
    TOUCHES = "touches"
    GCODE = "gcode"


def template(
    kind: Annotated[Example, typer.Argument(help="What the file is to hold.", show_default=False)],
) -> None:
    """Write a filled-in example of a file to standard output."""
    from importlib.resources import files

    from orthoglide_cal.files import new_machine

    if kind is Example.MACHINE:
        print(new_machine({"name": "my machine"}, "-"), end="")
    else:
        ending = "nc" if kind is Example.GCODE else "csv"
        shipped = files("orthoglide_cal.files") / "templates" / f"{kind}.{ending}"
        print(shipped.read_text(encoding="utf-8"), end="")
