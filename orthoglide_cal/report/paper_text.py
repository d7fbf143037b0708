"""The paper's tables, printed and computed, as text for a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from orthoglide_cal.estimation.reproduction import Reproduction


def render(found: Reproduction) -> RenderableType:
    """One table: two lines for each row, as printed and as computed, and the verdict."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="")
    table.add_column("")
    table.add_column("")
    for column in found.columns:
        table.add_column(column, justify="right", no_wrap=True)
    for row in found.rows:
        table.add_row(f"  {row.name}", "published", *_cells(row.published, found.digits))
        computed = row.computed or (None,) * len(row.published)
        table.add_row("", "computed", *_cells(computed, found.digits))
    name = "Accuracy" if found.table == "accuracy" else f"Table {found.table}"
    verdict = (
        Text("Reproduced in every figure that can be computed.", style="green")
        if found.reproduced
        else Text("NOT reproduced.", style="red")
    )
    notes = (Text(note) for note in found.notes)
    return Group(Text(f"{name}. {found.title}", style="bold"), table, *notes, verdict, Text())


def _cells(values: Sequence[float | None], digits: int) -> list[str]:
    return ["—" if v is None else f"{round(v, digits) + 0.0:.{digits}f}" for v in values]
