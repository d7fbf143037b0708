"""Layouts: places of a round bed to be touched, heights to touch them at, and minutes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from orthoglide_cal.model.kinds.probe_plan import ProbePlan
from orthoglide_cal.model.plan import Floats

# Pace assumed where nobody measured the time: a touch, and putting a block under the probe [min].
MINUTES_PER_TOUCH = 5.0 / 60.0
MINUTES_PER_BLOCK = 0.5
# Heights of blocks that lie about in a workshop, or are printed [mm].
BLOCKS_MM = (25.0, 50.0)
# The higher, the less a bed imitates a frame that is out of square.
HIGH_MM = max(BLOCKS_MM)
# Numbers of places, within this share of the bed's radius.
PLACES = (7, 13, 25, 49, 121)
REACH = 0.95
# A printed object to be measured: six pillars around one, at this share of the bed's radius.
PILLARS = 0.5
MINUTES_PER_PRINT, MINUTES_PER_DISTANCE = 60.0, 0.5
# To tell what a bed alone does not: so many places of the bed, so many of them on blocks, too.
SPREAD, RAISED = (25, 49, 81, 121, 169, 241), (7, 13, 19, 25, 31, 37, 49)
# Places are sent to a printer with this many decimals [mm].
DECIMALS = 1


class Layout(NamedTuple):
    """A way to measure that a kind of machine has to offer.

    Attributes:
        name: one word, for tables and commands.
        what: in words.
        plan: its readings.
        minutes: that it takes.
    """

    name: str
    what: str
    plan: Any
    minutes: float


def rings(count: int, radius: float) -> Floats:
    """The middle, and places on rings around it, evenly, shape (count, 2) [mm].

    Args:
        count: of places, at least 7.
        radius: of the outermost ring [mm].
    """
    # Ring k of n has a share of places that grows with k: as many as stand equally close.
    n = round((np.sqrt(1.0 + 4.0 * (count - 1) / 3.0) - 1.0) / 2.0)
    shares = np.cumsum(np.arange(1, n + 1)) / (n * (n + 1) / 2.0)
    ends = np.round((count - 1) * shares).astype(int)
    found = [np.zeros((1, 2))]
    for k, (begin, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True), start=1):
        turn = np.radians(30.0) + 2.0 * np.pi * (np.arange(end - begin) + k / 2.0) / (end - begin)
        away = radius * k / n
        found.append(away * np.stack((np.cos(turn), np.sin(turn)), axis=1))
    return np.asarray(np.round(np.vstack(found), DECIMALS) + 0.0, dtype=np.float64)


def to_and_fro(places: Floats) -> Floats:
    """The same places, each once, row by row, every other row backwards, shape (m, 2).

    So the time at which a place is touched has little to do with its distance from the middle,
    and what drifts is not taken for a shape.
    """
    at = np.unique(places, axis=0)
    low, high = at[:, 1].min(), at[:, 1].max()
    rows = max(round(np.sqrt(len(at))), 1)
    row = np.clip(((at[:, 1] - low) / (high - low) * rows).astype(int), 0, rows - 1)
    along = np.where(row % 2 == 0, at[:, 0], -at[:, 0])
    return np.asarray(at[np.lexsort((along, row))])


def compared(radius: float, calliper: float) -> tuple[Layout, ...]:
    """Ways to measure that are worth comparing: few places or many, blocks, a printed object.

    Args:
        radius: of the bed [mm].
        calliper: how precise a distance is beside a touch: ratio of the standard deviations.
    """
    reach = REACH * radius
    places = {count: to_and_fro(rings(count, reach)) for count in PLACES}
    heights = ", ".join(f"{height:g}" for height in BLOCKS_MM)
    turn = np.radians(30.0 + 60.0 * np.arange(6))
    ring = PILLARS * radius * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    first = np.vstack((np.zeros((6, 2)), ring))
    printed = first, np.vstack((ring, np.roll(ring, -1, axis=0)))
    flat, raised, measured = [], [], []
    for count, at in places.items():
        bed, up = [(at, 0.0)], [(at, height) for height in BLOCKS_MM]
        flat.append(_layout(f"bed-{count}", f"{count} places of the bed", bed))
        what = f"{count} places of the bed, and again on blocks of {heights} mm"
        raised.append(_layout(f"blocks-{count}", what, bed + up))
        what = f"{count} places of the bed, and {len(first)} distances on a printed object"
        measured.append(_layout(f"print-{count}", what, bed, printed, calliper))
    return (*flat, *raised, *measured)


def telling(radius: float) -> tuple[Layout, ...]:
    """Touches that tell a frame out of square from a bent bed more or less, quickest first.

    Args:
        radius: of the bed [mm].
    """
    reach = REACH * radius
    found = []
    for some in RAISED:
        upper = rings(some, reach)
        for count in SPREAD:
            # A place that is touched on both heights has one local shape.
            bed = to_and_fro(np.vstack((rings(count, reach), upper)))
            what = (
                f"{len(bed)} places of the bed, and {some} of them again on a block of"
                f" {HIGH_MM:g} mm"
            )
            parts = [(bed, 0.0), (to_and_fro(upper), HIGH_MM)]
            found.append(_layout("telling", what, parts))
    return tuple(sorted(found, key=lambda each: each.minutes))


def _layout(
    name: str,
    what: str,
    parts: Sequence[tuple[Floats, float]],
    printed: tuple[Floats, Floats] | None = None,
    calliper: float = 1.0,
) -> Layout:
    """Touches of places (m, 2), height by height, then distances between places (d, 2) [mm]."""
    first = np.vstack([np.column_stack((at, np.full(len(at), high))) for at, high in parts])
    other, touches = first, len(first)
    pace = np.where(first[:, 2] > 0.0, MINUTES_PER_TOUCH + MINUTES_PER_BLOCK, MINUTES_PER_TOUCH)
    if printed is not None:
        first, other = (
            np.vstack((first, np.column_stack((at, np.zeros(len(at)))))) for at in printed
        )
        other[:touches] = first[:touches]
        pace = np.append(pace, np.full(len(first) - touches, MINUTES_PER_DISTANCE))
        pace[touches] += MINUTES_PER_PRINT
    distance = np.arange(len(first)) >= touches
    plan = ProbePlan(
        order=np.arange(len(first)),
        hours=(np.cumsum(pace) - pace[0]) / 60.0,
        place=first,
        other=other,
        surface=np.where(distance, 0.0, first[:, 2]),
        distance=distance,
        weight=np.where(distance, calliper, 1.0),
    )
    return Layout(name, what, plan, float(pace.sum()))
