"""Checking a YAML tree against a pydantic model; every fault gets its line, path and remedy.

The annotated types are the vocabulary of the models: YAML scalars arrive as text (yaml_tree), and
each type says what it makes of a text.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from datetime import date, datetime
from typing import Annotated, Any, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, ValidationError
from pydantic_core import PydanticCustomError

from orthoglide_cal.data.cause_ids import CAUSE_IDS
from orthoglide_cal.data.faults import MOST_FAULTS, nearest
from orthoglide_cal.data.numbers import number_text, parse_count, parse_yaml_number
from orthoglide_cal.data.yaml_tree import Path, Tree, dotted
from orthoglide_cal.errors import InputError

Model = TypeVar("Model", bound=BaseModel)


class Strict(BaseModel):
    """A group of keys; an unknown one is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def fault(
    what: str, remedy: str, path: Path = (), known: Sequence[str] = ()
) -> PydanticCustomError:
    """What a validator raises.

    Args:
        what, remedy: as in `InputError`.
        path: the field, if the validator is the whole model's.
        known: words of which the value may be a misspelling.
    """
    context = {"what": what, "remedy": remedy, "path": path, "known": known}
    return PydanticCustomError("fault", "{what}", context)


def as_number(value: Any) -> float:
    """The number in a YAML scalar or a Python number; a fault for anything else."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise fault("A number is wanted here.", "Write a plain number such as 310.25.")
    try:
        return parse_yaml_number(value if isinstance(value, str) else repr(value))
    except InputError as error:
        raise fault(error.what, error.remedy) from error


def _positive(value: float) -> float:
    if value <= 0.0:
        raise fault("The number must be greater than zero.", "Give its size.")
    return value


def _not_negative(value: float) -> float:
    if value < 0.0:
        raise fault("The number must not be negative.", "Give zero or more.")
    return value


def _text(value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise fault("A text is wanted here.", "Write a word or put the text in quotes.")
    return number_text(float(value)) if isinstance(value, int | float) else value


def _filled(value: str) -> str:
    if not value.strip():
        raise fault("The text is empty.", "Write a word or put the text in quotes.")
    return value


def _count(value: Any) -> int:
    try:
        return parse_count(str(value), 1)
    except InputError as error:
        raise fault(error.what, error.remedy) from error


def _version(value: Any) -> int:
    if str(value) != "1":
        raise fault(
            "This version of the file format is not known.",
            "Write 1, or use the orthocal that wrote the file.",
        )
    return 1


def _cause(value: str) -> str:
    if value not in CAUSE_IDS:
        raise fault("This is not a cause id.", f"Known: {', '.join(CAUSE_IDS)}.", known=CAUSE_IDS)
    return value


def _day(value: str) -> str:
    try:
        date.fromisoformat(value[:10])
        datetime.fromisoformat(value)
    except ValueError as error:
        raise fault("This is not a date.", "Write it as 2025-01-31.") from error
    return value


def _moment(value: str) -> str:
    try:
        datetime.fromisoformat(value)
    except ValueError as error:
        raise fault("This is not a time.", "Write it as 2025-01-31T14:05:00.") from error
    return value


def _digest(value: str) -> str:
    if not re.fullmatch("[0-9a-f]{64}", value):
        raise fault("This is not a SHA-256 digest.", "Give its 64 hexadecimal digits.")
    return value


Number = Annotated[float, BeforeValidator(as_number)]
Positive = Annotated[Number, AfterValidator(_positive)]
NotNegative = Annotated[Number, AfterValidator(_not_negative)]
Count = Annotated[int, BeforeValidator(_count)]
Text = Annotated[str, BeforeValidator(_text)]
Word = Annotated[Text, AfterValidator(_filled)]
Version = Annotated[int, BeforeValidator(_version)]
CauseId = Annotated[str, AfterValidator(_cause)]
Day = Annotated[Text, AfterValidator(_day)]
Moment = Annotated[Text, AfterValidator(_moment)]
Digest = Annotated[Text, AfterValidator(_digest)]

_KINDS = {
    "missing": ("The key is missing.", "Add it."),
    "model_type": ("A group of keys is wanted here.", "Write `name: value` lines, indented."),
    "dict_type": ("A group of keys is wanted here.", "Write `name: value` lines, indented."),
    "list_type": ("A list is wanted here.", "Write [first, second] or `- …` lines."),
    "tuple_type": ("A list is wanted here.", "Write [first, second] or `- …` lines."),
    "too_long": ("The list has too many entries.", "Remove some."),
}


def check_tree(model: type[Model], tree: Tree, path: Path = ()) -> Model:
    """The model that `tree` (or its part at `path`) describes.

    Raises:
        InvalidFileError: everything that does not fit, each with line and dotted path; duplicate
            keys included.
    """
    value = tree.value
    for part in path:
        value = value[part]
    try:
        checked = model.model_validate(value)
    except ValidationError as error:
        for entry in error.errors(include_url=False)[:MOST_FAULTS]:
            _note(tree, model, path, entry)
        tree.faults.check(error)
        raise
    tree.faults.check()
    return checked


def _note(tree: Tree, model: type[BaseModel], prefix: Path, entry: Any) -> None:
    context = entry.get("ctx", {})
    place: Path = tuple(part for part in entry["loc"] if part != "[key]")
    place = (*prefix, *place, *context.get("path", ()))
    kind, value = entry["type"], entry["input"]
    if kind == "fault":
        hint = nearest(str(value), context["known"])
        what, remedy = context["what"], hint + context["remedy"]
    elif kind == "extra_forbidden":
        known = _keys(model, entry["loc"][:-1])
        what = "The key is not known."
        remedy = f"{nearest(str(place[-1]), known)}Known here: {', '.join(known)}."
    else:
        what, remedy = _KINDS.get(kind, (f"{entry['msg']}.", "Compare with a file that works."))
    if kind == "missing" and isinstance(place[-1], int):
        what, remedy = "The list is too short.", "Add an entry."
    elif kind == "missing":
        remedy = f"Add a line `{place[-1]}: …`."
    shown = value if isinstance(value, str) and kind != "missing" else None
    tree.faults.add(what, remedy, line=tree.line(place), column=dotted(place), value=shown)


def _keys(model: type[BaseModel], path: Path) -> list[str]:
    """Names of the keys of the model at `path` inside `model`."""
    at = model
    for part in path:
        if isinstance(part, str) and part in at.model_fields:
            at = next(_models(at.model_fields[part].annotation), at)
    return list(at.model_fields)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """The model that an annotation names, also inside a list, tuple, dict or union."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)
