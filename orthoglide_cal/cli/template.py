"""`orthocal template`: a filled-in example of a file, to be written over with one's own numbers."""

from __future__ import annotations

from typing import Annotated, Literal

from orthoglide_cal.cli.common import argument


def template(
    kind: Annotated[
        Literal["readings", "differences", "machine", "touches", "gcode"],
        argument("KIND", "readings, differences, machine, touches or gcode."),
    ],
) -> None:
    """Write a filled-in example of a file to standard output."""
    from importlib.resources import files

    from orthoglide_cal.files import new_machine

    if kind == "machine":
        print(new_machine({"name": "my machine"}, "-"), end="")
    else:
        ending = "nc" if kind == "gcode" else "csv"
        shipped = files("orthoglide_cal.files") / "templates" / f"{kind}.{ending}"
        print(shipped.read_text(encoding="utf-8"), end="")
