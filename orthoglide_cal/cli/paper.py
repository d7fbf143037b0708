"""`orthocal paper`: the paper's tables computed again, beside what was printed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from orthoglide_cal.cli.common import AsJson, NoColour, deliver, messages, option
from orthoglide_cal.errors import UnusableResultError

if TYPE_CHECKING:
    from orthoglide_cal.paper.tables import Reproduction


class TableName(StrEnum):
    """What can be reproduced."""

    T1 = "1"
    T3 = "3"
    T4 = "4"
    T5 = "5"
    ACCURACY = "accuracy"


def paper(
    table: Annotated[
        TableName | None, option(help="Only this one; without it all of them.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the noise of Table 3.")] = 1,
    json: AsJson = False,
    no_colour: NoColour = False,
) -> None:
    """Reproduce the tables of the paper that the method comes from."""
    from orthoglide_cal.report.documents.checks import paper_document

    missed = False
    for name in TableName if table is None else (table,):
        found = _compute(name, seed)
        deliver(paper_document(found), as_json=json)
        missed |= not found.reproduced
    if missed:
        raise typer.Exit(UnusableResultError.exit_code)


def _compute(name: TableName, seed: int) -> Reproduction:
    import numpy as np

    from orthoglide_cal.files import default_machine
    from orthoglide_cal.paper import tables

    prototype = default_machine()
    if name is TableName.T3:
        with _progress("Table 3, solves") as progress:
            return tables.table_3(prototype, np.random.default_rng(seed), progress)
    simple = {
        TableName.T1: tables.table_1,
        TableName.T4: tables.table_4,
        TableName.T5: tables.table_5,
        TableName.ACCURACY: tables.accuracy,
    }
    return simple[name](prototype)


@contextmanager
def _progress(title: str) -> Iterator[Callable[[int, int], None] | None]:
    """A bar on standard error while it is a terminal; otherwise None."""
    console = messages()
    if not console.is_terminal:
        yield None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), Remaining())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(title)
        yield lambda done, total: bar.update(task, completed=done, total=total)
