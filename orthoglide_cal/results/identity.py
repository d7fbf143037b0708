"""The number of a report: it follows from what went into it, not from when it is shown."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from datetime import UTC, datetime

from pydantic import AwareDatetime, Field

from orthoglide_cal import __version__
from orthoglide_cal.files import machine_values
from orthoglide_cal.model import Model, Source
from orthoglide_cal.schema import Schema


class Identity(Schema):
    """What makes a report unique."""

    number: str = Field(description="the same for the same inputs and options")
    issued: AwareDatetime
    software: str


def identify(
    inputs: Iterable[tuple[Source, Model]], *options: object, issued: datetime | None = None
) -> Identity:
    """Who this result is.

    What was entered in the controller later changes no result: it is not part of the number.

    Args:
        inputs: each file, with the machine that it is judged by.
        options: whatever else changes the result; their `str` distinguishes them.
        issued: time of issue; now if None.
    """
    software = f"orthocal {__version__}"
    parts = [
        (
            source.sha256,
            *([source.excerpt.data] if source.excerpt else []),
            *model.ruled_out,
            {name: said for name, said in machine_values(model).items() if name != "history"},
        )
        for source, model in inputs
    ]
    made_of = repr((software, parts, [str(option) for option in options]))
    digest = hashlib.sha256(made_of.encode()).hexdigest()[:12].upper()
    return Identity(
        number=f"OC-{digest[:6]}-{digest[6:]}",
        issued=issued or datetime.now(UTC),
        software=software,
    )
