"""`orthocal paper`: the paper's tables computed again, next to the printed values."""

from collections.abc import Callable
from functools import partial
from typing import Literal

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import option
from orthoglide_cal.errors import UnusableResultError


def paper(
    table: Literal["1", "3", "4", "5", "accuracy"] | None = option(
        None, "Table to print. Default: all."
    ),
    seed: int = option(
        "N", "Whole number; it decides the noise of Table 3. Default: 1.", min=0, default=1
    ),
    json: bool = common.JSON,
) -> int:
    """Reproduce the tables of the paper that describes the method."""
    import numpy as np

    from orthoglide_cal.files.machine_file import default_machine
    from orthoglide_cal.model.model import Model
    from orthoglide_cal.paper import tables
    from orthoglide_cal.report.documents.short import paper_document

    makers: dict[str, Callable[[Model], tables.Reproduction]] = {
        "1": tables.table_1,
        "3": partial(tables.table_3, rng=np.random.default_rng(seed)),
        "4": tables.table_4,
        "5": tables.table_5,
        "accuracy": tables.accuracy,
    }
    missed = False
    for name in [table] if table else makers:
        result = makers[name](default_machine())
        common.deliver(paper_document(result), as_json=json)
        missed |= not result.reproduced
    return UnusableResultError.exit_code if missed else 0
