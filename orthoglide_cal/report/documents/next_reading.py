"""What to measure next: the one sentence of a diagnosis, and the whole ranking of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import Diagnosis, Verdict
from orthoglide_cal.model import Model
from orthoglide_cal.planning import Next
from orthoglide_cal.planning.next_reading import SETTLES
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.documents.parameters import JOINTS, by_joint
from orthoglide_cal.report.json import fields_of
from orthoglide_cal.report.words import percent, two_figures

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
    ids = (*(cause.id for cause in diagnosis.causes), *diagnosis.ambiguous_with)
    mended = all(not CAUSES[id].in_machine for id in ids)
    again = " All of them lie in the measurement: measure again." if mended else ""
    return (doc.Paragraph(f"No further reading of this kind would tell them apart.{again}"),)


def next_section(found: Sequence[Next]) -> doc.Section:
    """The best of the ranking as a table."""
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
    heads = ("", "min", *(("settles", "σ") if telling else ()), "U, mm", "what to do")
    if telling and found[0].separates is not None:
        first, second = told_apart(found[0])
        meaning = (
            "Settles: the chance that one name is left. First what settles almost surely"
            f" ({percent(SETTLES)}), the quickest first; then by that chance per minute. σ: how far"
            f" {first} and {second} are apart in the new readings, in standard deviations."
        )
    else:
        meaning = (
            "Nothing that further readings could tell is open: ranked by how much U they save per"
            " minute."
        )
    return doc.Section(
        "What to measure next, best first",
        (doc.Grid(heads, tuple(rows), words=(len(heads) - 1,), caption=meaning),),
    )


def next_data(found: Sequence[Next], model: Model) -> list[dict[str, Any]]:
    """Key `next` of the plan's contract."""
    return [
        {**told_data(each), "minutes": each.option.minutes}
        | {"expanded_mm": by_joint(model, each.expanded_mm), "chance": each.chance}
        for each in found
    ]


def told_data(each: Next) -> dict[str, Any]:
    """Key `next_measurement` of the diagnosis' contract."""
    names = each.separates
    return {
        "what": each.option.what,
        "separates": ["+".join(ids) for ids in names or ()],
        **fields_of(each, "separation_sigma"),
    }


def told_apart(each: Next) -> tuple[str, str]:
    """The two explanations that it tells apart, in words."""
    first, second = ("+".join(ids) or "a sound machine" for ids in each.separates or ((), ()))
    return first, second
