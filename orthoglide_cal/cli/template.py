"""`orthocal template`: an example file, to be overwritten with your own numbers."""

from typing import Literal

from orthoglide_cal.cli.common import argument


def template(
    kind: Literal["readings", "differences", "machine", "touches", "gcode"] = argument(
        "KIND", "readings, differences, machine, touches or gcode.", required=True
    ),
) -> None:
    """Print an example file to fill in with your own numbers."""
    from importlib.resources import files

    ending = {"machine": "yaml", "gcode": "nc"}.get(kind, "csv")
    shipped = files("orthoglide_cal") / "files" / "templates" / f"{kind}.{ending}"
    print(shipped.read_text(encoding="utf-8"), end="")
