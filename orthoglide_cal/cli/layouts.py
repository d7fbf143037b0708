"""`orthocal plan` for machines that have layouts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from orthoglide_cal.cli import common
from orthoglide_cal.errors import UsageError

if TYPE_CHECKING:
    from orthoglide_cal.planning.layouts import Laid

_CSV = ".csv"


def write_places(laid: Laid, target: Path) -> None:
    """Write the places of a layout as a file to be filled in; "-" shows it.

    Raises:
        UsageError: another kind of file, a layout with distances, or the file exists.
    """
    from orthoglide_cal.files import places_csv, write_text

    if laid.layout.plan.distance.any():
        raise UsageError(
            "Distances on a printed object are not probed.",
            "Choose a layout without them: --layout",
        )
    text = places_csv(laid.layout.plan)
    if str(target) == "-":
        print(text, end="")
        return
    if target.suffix.lower() != _CSV:
        raise UsageError(
            f"What {target} is to be cannot be told from its name.",
            f"End it in {_CSV}: places to probe are a table.",
        )
    write_text(target, text)
    common.tell(
        f"{len(laid.layout.plan)} places written to {target}: {laid.layout.what}. Fill in"
        " reading_mm, the height at which the probe triggers, bed mesh off."
    )
