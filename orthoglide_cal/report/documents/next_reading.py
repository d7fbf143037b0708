"""What to measure next: the one sentence of a diagnosis, and the whole ranking of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import Diagnosis, Verdict
from orthoglide_cal.diagnosis.candidates import Ids
from orthoglide_cal.model import Model
from orthoglide_cal.planning import Next
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.documents.parameters import JOINTS, by_joint
from orthoglide_cal.report.json import fields_of
from orthoglide_cal.words import percent, two_figures

_SHOWN = 6  # of the ranking


def next_blocks(diagnosis: Diagnosis, following: Next | None) -> tuple[doc.Block, ...]:
    """The reading that would decide what is open."""
    if following is not None and following.separates is not None:
        first, second = told_apart(following)
        apart = f"{following.separation_sigma:.1f} standard deviations"
        return (
            doc.Paragraph((doc.Strong("Read next: "), following.option.what)),
            doc.Paragraph(
                f"It takes about {following.option.minutes:.0f} min and tells {first} from"
                f" {second} by {apart}."
            ),
        )
    if diagnosis.verdict is not Verdict.AMBIGUOUS:
        return ()
    open_ = {*diagnosis.ambiguous_with, *(cause.id for cause in diagnosis.causes if cause.aliases)}
    mended = all(not CAUSES[id].in_machine for id in open_)
    again = (
        " What is open lies in the measurement: measure there again, and leave the old readings"
        " out. Then it does not matter which it was."
    )
    told = f"No further reading of this kind is likely to tell.{again if mended else ''}"
    return (doc.Paragraph(told),)


def next_section(found: Sequence[Next], now_mm: float | None = None) -> doc.Section:
    """The best of the ranking as a table; `now_mm` is the largest U without it, if it is known."""
    telling = any(each.separates is not None for each in found)
    rows = [
        (
            str(number),
            f"{each.option.minutes:.0f}",
            *((percent(each.chance), f"{each.separation_sigma:.1f}") if telling else ()),
            two_figures(float(each.expanded_mm[:JOINTS].max())),
            each.option.what,
        )
        for number, each in enumerate(found[:_SHOWN], start=1)
    ]
    if now_mm is not None:
        rows.insert(
            0, ("", "", *(("", "") if telling else ()), two_figures(now_mm), "nothing: U as it is")
        )
    heads = ("", "min", *(("settles", "σ") if telling else ()), "U, mm", "what to do")
    if telling and found[0].separates is not None:
        first, second = told_apart(found[0])
        meaning = (
            "Settles: the chance that one answer is left. Ranked by that chance per minute, eight"
            " hours added for coming back if it stays open. σ: how far"
            f" {first} and {second} are apart in the new readings, in standard deviations."
        )
    else:
        meaning = (
            "Nothing that further readings could tell is open: ranked by how much U they save per"
            " minute, half an hour added for the sitting."
        )
    return doc.Section(
        "What to measure next, best first",
        (doc.Grid(heads, tuple(rows), words=(len(heads) - 1,), caption=meaning),),
    )


def next_data(found: Sequence[Next], model: Model) -> list[dict[str, Any]]:
    """Key `next` of the plan's contract."""
    return [
        {**told_data(each), "minutes": round(each.option.minutes, 2)}
        | {"expanded_mm": by_joint(model, each.expanded_mm), "chance": each.chance}
        for each in found
    ]


def told_data(each: Next) -> dict[str, Any]:
    """Key `next_measurement` of the diagnosis' contract."""
    return {
        "what": each.option.what,
        "separates": [] if each.separates is None else _ids_apart(*each.separates),
        **fields_of(each, "separation_sigma"),
    }


def _ids_apart(one: Ids, other: Ids) -> list[str]:
    """Of each of two explanations the first cause that the other lacks, or has as well."""
    pairs = ((one, other), (other, one))
    return [min(ids, key=lambda id: id in rival, default="") for ids, rival in pairs]


def told_apart(each: Next) -> tuple[str, str]:
    """The two explanations that it tells apart, in words."""
    first, second = (" with ".join(ids) or "a sound machine" for ids in each.separates or ((), ()))
    return first, second
