"""Results as plain values for programs, and these as one JSON object on one line."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from orthoglide_cal.model import AXES, Floats

SCHEMA_VERSION = 1


def fields_of(value: object, *names: str) -> dict[str, Any]:
    """The named attributes, in this order; arrays and tuples become lists."""
    return {name: _plain(getattr(value, name)) for name in names}


def by_axis(values: Sequence[Any] | Floats) -> dict[str, Any]:
    """x, y, z → value."""
    return dict(zip(AXES, _plain(values), strict=True))


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    return list(value) if isinstance(value, tuple) else value


def json_line(data: Mapping[str, Any]) -> str:
    """The object without a line break; NaN and infinity are refused (ValueError)."""
    return json.dumps(data, allow_nan=False, ensure_ascii=False)
