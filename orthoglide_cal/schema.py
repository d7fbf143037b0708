"""The base of everything that is read from a file or written to one, and what its texts may be.

The types below take the text of a file or the value itself. `float()` would take nan, inf and
1_000 and refuse the typographic minus U+2212; YAML would read 012 as 10 and 1:30 as 90.

What is wrong with a text is an `InputError` without a place: pydantic adds the path, `files.tree`
the file and the line.
"""

import math
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import date, datetime
from typing import Annotated, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    SerializationInfo,
    WithJsonSchema,
    model_serializer,
)
from pydantic.fields import FieldInfo

from orthoglide_cal.errors import InputError

MACHINE_FILE = "machine.yaml"  # what it is called unless another name is given
_LONGEST = 40  # characters; a gauge shows ten
_NUMBER = re.compile(r"[+-]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_OCTAL = re.compile(r"[+-]?0[0-9]+")
_INTEGER = re.compile(r"\+?[0-9]{1,15}")
_EXAMPLE = "Write a plain number such as -0.123."


class Schema(BaseModel):
    """Base of the content of one file, or of one group of keys; an unknown key is a fault."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        defer_build=True,
        arbitrary_types_allowed=True,  # what is not printed, such as arrays
    )

    def changed(self, **fields: object) -> Self:
        """The same with other values of some fields, which nobody checks."""
        if unknown := fields.keys() - type(self).model_fields.keys():
            raise TypeError(f"{type(self).__name__} has no {', '.join(sorted(unknown))}.")
        return self.model_copy(update=fields)


class Reason(Schema):
    """Fact to know of a result: a code with its data; `report` composes its sentence."""

    code: str
    data: Mapping[str, object] = Field(default_factory=dict)

    @classmethod
    def of(cls, code: str, **data: object) -> Self:
        return cls(code=code, data=data)

    @model_serializer
    def sentence(self, info: SerializationInfo) -> str:
        """The sentence that the dump's context composes, or the code."""
        return info.context(self) if callable(info.context) else self.code


# A reason, as other programs see it.
Sentence = Annotated[Reason, WithJsonSchema({"type": "string"})]


def ask(title: str, why: str, unit: str = ", mm") -> FieldInfo:
    """A field for which people are asked: its name, its meaning, its unit."""
    field: FieldInfo = Field(title=f"{title}{unit} ({why})")
    return field


def parse_number(text: str, *, decimal_comma: bool = False) -> float:
    """The finite number that `text` writes: digits with optional sign, decimal mark and exponent.

    The sign is ASCII, or U+2212 as spreadsheets write it. Raises InputError, without a place.

    >>> parse_number("−0,25", decimal_comma=True)
    -0.25
    """
    plain = text.strip().replace("\u2212", "-")
    if len(plain) > _LONGEST or not _NUMBER.fullmatch(plain):
        raise InputError("This is not a number.", _EXAMPLE, value=text)
    if "," in plain and not decimal_comma:
        raise InputError(
            "A decimal comma cannot be read here.",
            "Write a decimal point. (A table may have commas: separate columns with semicolons.)",
            value=text,
        )
    value = float(plain.replace(",", "."))
    if not math.isfinite(value):
        raise InputError("This number is too large.", _EXAMPLE, value=text)
    return value


def parse_count(text: str, least: int) -> int:
    """The whole number that `text` writes, at least `least`. Raises InputError without a place."""
    plain = text.strip()
    if not _INTEGER.fullmatch(plain) or int(plain) < least:
        raise InputError(
            f"This is not a whole number from {least}.",
            f"Write {least}, {least + 1}, {least + 2}, …",
            value=text,
        )
    return int(plain)


def yaml_number(value: object) -> float:
    """The number that a text of a file writes, or the number itself. Raises InputError."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value
    if not isinstance(value, str):
        raise InputError("This must be a number.", "Write a plain number such as 310.25.")
    if _OCTAL.fullmatch(value.strip()):
        fault = "A whole number with a leading zero is ambiguous (YAML reads it as octal)."
        raise InputError(fault, "Write it without the leading zero.")
    return parse_number(value)


def whole_number(least: int) -> BeforeValidator:
    """A whole number from `least`, or the text of one."""
    return BeforeValidator(
        lambda value: value if isinstance(value, int) else parse_count(str(value), least)
    )


def _version(value: object) -> object:
    if value not in (1, "1"):
        fault = "This version of the file format is not known."
        raise InputError(fault, "Write 1, or use the orthocal that wrote the file.")
    return 1


def text_that(passes: Callable[[str], object], fault: str, remedy: str) -> AfterValidator:
    """A text that passes a check, which is false or raises ValueError for others."""

    def check(text: str) -> str:
        with suppress(ValueError):
            if passes(text):
                return text
        raise InputError(fault, remedy)

    return AfterValidator(check)


Number = Annotated[float, BeforeValidator(yaml_number)]
Minutes = Annotated[float, PlainSerializer(lambda minutes: round(minutes, 2))]
Positive = Annotated[Number, Field(gt=0.0)]
Count = Annotated[int, whole_number(1)]  # a whole number from 1
Version = Annotated[int, BeforeValidator(_version)]
# A text that says something.
Word = Annotated[
    str, text_that(str.strip, "The text is empty.", "Write a word or put the text in quotes.")
]
# An ISO date, perhaps with the time.
Day = Annotated[
    str,
    text_that(
        lambda text: date.fromisoformat(text[:10]) and datetime.fromisoformat(text),
        "This is not a date.",
        "Write it as 2025-01-31.",
    ),
]
Moment = Annotated[  # an ISO time
    str,
    text_that(datetime.fromisoformat, "This is not a time.", "Write it as 2025-01-31T14:05:00."),
]
Digest = Annotated[  # SHA-256
    str,
    text_that(
        re.compile("[0-9a-f]{64}").fullmatch,
        "This is not a SHA-256 digest.",
        "Give its 64 hexadecimal digits.",
    ),
]
