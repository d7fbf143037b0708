"""The template of a posture program: what its owner wrote for their controller.

Lines that are a comment beginning with "orthocal" are settings, notes, or the marker that says
where the blocks go; all others are copied as they stand.
"""

import re
from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, ValidationError

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.faults import Content, nearest
from orthoglide_cal.files.text import FileText
from orthoglide_cal.schema import Positive, Schema, text_that

_OURS = re.compile(r"\s*(?:\(\s*orthocal\b([^()]*)\)|;\s*orthocal\b(.*))\s*", re.IGNORECASE)
_AXIS = re.compile(r"[UVWABCXYZ]|[A-Z][A-Z0-9_]*=")
_WAITS = text_that(
    re.compile(r"M0?[01]|M60|G0?4( [A-Z][0-9]+(\.[0-9]+)?)+").fullmatch,
    "This code does not wait.",
    "Write M0, M1, or G4 P20 for 20 s.",
)
_COMMENT = re.compile(r"\([^)]*\)?|;.*")
_NUMBER = re.compile(r"\s*/?\s*N0*([0-9]+)", re.IGNORECASE)
_CODE = re.compile(r"G0*([0-9]+)(?![0-9.])", re.IGNORECASE)
_PRINT = "For a complete one: orthocal template gcode"
# Codes of which the last one holds: that for which the blocks are written, and what others mean.
_MODES = (
    {"21": "", "71": "", "710": "", "20": "inches", "70": "inches", "700": "inches"},
    {"90": "", "91": "distances from the last point"},
    {"94": "", "93": "feeds as inverse times", "95": "feeds per turn"},
)


def _axes(value: object) -> tuple[str, ...]:
    words = tuple(value.upper().split()) if isinstance(value, str) else ()
    if len(set(words)) != 3 or len(words) != 3 or not all(map(_AXIS.fullmatch, words)):
        raise InputError("These are not three axis words.", "Write X Y Z, or X1= Y1= Z1=.")
    return words


class Template(Schema):
    """A template as read."""

    before: tuple[str, ...]  # lines around the blocks
    after: tuple[str, ...]
    semicolon: bool  # comments are written "; …" instead of "(…)", as the marker is
    axes: Annotated[tuple[str, ...], BeforeValidator(_axes)] = ("X", "Y", "Z")  # axis words
    # Meaning of the numbers behind the axis words.
    values: Annotated[Literal["joints", "displacements", "tool"], BeforeValidator(str.lower)] = (
        "joints"
    )
    pause: Annotated[str, AfterValidator(str.upper), _WAITS] = "M0"  # waits at each posture
    feed: Positive = 1000.0  # between postures [mm/min]
    slow: Positive = 100.0  # on arrival [mm/min]


def gcode_template(document: FileText, numbers: Iterable[int]) -> Template:
    """The template that a file holds.

    Raises InputError: no marker or two, a setting that cannot be used, one of the numbers of
    the blocks to be written, or a mode (inches, relative) in which they would drive elsewhere.
    """
    content, taken = Content(document), set(numbers)
    known = [name for name, field in Template.model_fields.items() if not field.is_required()]
    settings = content.value = dict[str, str]()
    before, after, marker = list[str](), list[str](), ""
    modes: dict[int, tuple[int, str]] = {}
    for line, text in enumerate(document.text.rstrip("\n").split("\n"), start=1):
        if ours := _OURS.fullmatch(text):
            key, _, value = (ours[1] or ours[2] or "").partition(":")
            name = key.strip().lower()
            if name in settings or (name == "blocks" and marker):
                content.add("This is given twice.", "Take one out.", line=line, value=key)
            elif name == "blocks":
                marker = text.strip()
            elif name in known:
                settings[name], content.lines[name,] = " ".join(value.split()), line
            elif name != "note":
                near = nearest(name, (*known, "note", "blocks"))
                content.add("This is not a setting.", f"{near}{_PRINT}", line=line, value=name)
            continue
        (after if marker else before).append(text)
        code = _COMMENT.sub("", text)
        if (number := _NUMBER.match(code)) and int(number[1]) in taken:
            wrong, value = "A posture has this block number.", f"N{number[1]}"
            content.add(wrong, "Number your own lines otherwise, or not at all.", line, value=value)
        for mode in [] if marker else _CODE.findall(code):
            modes |= {k: (line, mode) for k, codes in enumerate(_MODES) if mode in codes}
    for k, (line, mode) in modes.items():
        if meaning := _MODES[k][mode]:
            wrong = f"The blocks are not written for this code ({meaning})."
            remedy = f"Write G{next(iter(_MODES[k]))} before the blocks."
            content.add(wrong, remedy, line=line, value=f"G{mode}")
    if not marker:
        wrong = "The template does not say where the blocks go."
        content.add(wrong, f"Put a line (orthocal blocks) there. {_PRINT}")
    around = {"before": before, "after": after, "semicolon": marker.startswith(";")}
    try:
        template = Template.model_validate({**around, **settings})
    except ValidationError as error:
        content.take(error, Template)
    content.check()
    return template
