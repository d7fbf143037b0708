"""The machine as a picture: its legs, and where the gauges stood."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from orthoglide_cal.model import AXES, Floats, Series
from orthoglide_cal.report.canvas import svg, words
from orthoglide_cal.report.escape import Html, tag

WIDTH, HEIGHT = 360.0, 296.0
CENTRE = np.array([180.0, 186.0])
LEG = 128.0  # length of a leg in the picture
# Where the axes x, y, z point on the paper.
ON_PAPER = np.array([[-0.84, 0.50], [0.84, 0.50], [0.0, -1.0]])


def machine(
    leg_length_mm: float,
    joint_limits_mm: tuple[float, float],
    gauges: Sequence[tuple[int, int, float]],
    faults: Collection[tuple[int, int]] = (),
    rails: Collection[int] = (),
) -> Html:
    """Isometric sketch at the isotropic posture.

    Args:
        leg_length_mm: L.
        joint_limits_mm: travel of the carriages from the isotropic posture.
        gauges: (leg, direction, place along the leg from carriage 0 to tool 1).
        faults: (leg, direction) whose readings a fault spoils: a ring around their gauges.
        rails: those in which a fault is: a line beside them.
    """
    scale = LEG / leg_length_mm
    parts: list[Html] = []
    for leg, axis in enumerate(AXES):
        low, high = ((leg_length_mm + limit) * scale / LEG for limit in joint_limits_mm)
        # Even displacements of the carriage leave the picture readable only up to here.
        end = min(high, 1.0 + 34.0 / LEG)
        across = np.array([-ON_PAPER[leg, 1], ON_PAPER[leg, 0]])
        side = 4.0 * across / np.linalg.norm(across)
        joint, tool = _at(leg, 1.0), _at(leg, 0.0)
        x, y = (joint - 7.0).tolist()
        at, below = _at(leg, end + 0.10).tolist()
        drawn = (
            _line(_at(leg, low), _at(leg, end), "rail"),
            _line(joint + side, tool + side, "bar"),
            _line(joint - side, tool - side, "bar"),
            tag("rect", x=x, y=y, width=14, height=14, rx=2, class_="carriage"),
            words(at, below + 4.0, axis, "middle", "axis"),
            *(
                [_line(_at(leg, low) + 2.5 * side, _at(leg, end) + 2.5 * side, "fault")]
                if leg in rails
                else ()
            ),
        )
        parts.append(tag("g", *drawn, class_=f"c-{axis}"))
    x, y = CENTRE.tolist()
    parts.append(tag("circle", cx=x, cy=y, r=8.0, class_="tool"))
    parts += [_gauge(*gauge, (gauge[0], gauge[1]) in faults) for gauge in gauges]
    placed = ", ".join(
        f"leg {AXES[leg]} in direction {AXES[direction]} at {100 * place:.0f} % of the leg"
        for leg, direction, place in gauges
    )
    finding = "Three legs run from the tool in the middle to carriages on the rails x, y and z."
    if gauges:
        finding += f" Gauges: {placed}."
    if faults:
        marked = "; ".join(Series(*fault).words for fault in sorted(faults))
        finding += f" Marked, because a fault spoils its readings: {marked}."
    if rails:
        marked = ", ".join(AXES[rail] for rail in sorted(rails))
        finding += f" Marked, because a fault is in it: axis {marked}."
    return svg("machine", WIDTH, HEIGHT, "The machine and its gauges", finding, *parts)


def _at(leg: int, fraction: float) -> Floats:
    return np.asarray(CENTRE + fraction * LEG * ON_PAPER[leg])


def _line(start: Floats, stop: Floats, class_: str) -> Html:
    (x1, y1), (x2, y2) = start.tolist(), stop.tolist()
    return tag("line", x1=x1, y1=y1, x2=x2, y2=y2, class_=class_)


def _gauge(leg: int, direction: int, place: float, faulty: bool) -> Html:
    """A dial on the side towards which its direction points: that way its reading grows."""
    touch = _at(leg, 1.0 - place)
    toward = ON_PAPER[direction] / np.linalg.norm(ON_PAPER[direction])
    dial = touch + 40.0 * toward
    x, y = dial.tolist()
    return tag(
        "g",
        _line(touch + 5.0 * toward, dial - 12.0 * toward, "plunger"),
        tag("circle", cx=x, cy=y, r=17.0, class_="fault") if faulty else None,
        tag("circle", cx=x, cy=y, r=12.0, class_="dial"),
        words(x, y + 4, f"+{AXES[direction]}", "middle", "small"),
        class_=f"c-{AXES[leg]}",
    )
