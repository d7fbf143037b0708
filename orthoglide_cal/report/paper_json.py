"""The paper's tables, printed and computed, as the object that `orthocal paper --json` prints."""

from __future__ import annotations

from typing import Any

from orthoglide_cal.estimation.reproduction import Reproduction


def as_json(found: Reproduction) -> dict[str, Any]:
    """One table; null where nothing was printed or nothing can be computed."""
    return {
        "schema_version": 1,
        "table": found.table,
        "title": found.title,
        "columns": list(found.columns),
        "rows": [
            {
                "name": row.name,
                "published": list(row.published),
                "computed": None if row.computed is None else list(row.computed),
                "allowed": row.allowed,
                "reproduced": None if row.computed is None else row.reproduced,
            }
            for row in found.rows
        ],
        "reproduced": found.reproduced,
        "notes": list(found.notes),
    }
