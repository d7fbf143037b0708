"""The machine with its three legs, and where each gauge stood."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orthoglide_cal.axes import AXES, Floats
from orthoglide_cal.report.figures.canvas import line, svg, words
from orthoglide_cal.report.markup import Html, join, tag

WIDTH, HEIGHT = 360.0, 296.0
CENTRE = np.array([180.0, 186.0])
LEG = 128.0  # length of a leg in the picture
# Where the axes x, y, z point on the paper.
ON_PAPER = np.array([[-0.84, 0.50], [0.84, 0.50], [0.0, -1.0]])


def machine(
    leg_length_mm: float,
    joint_limits_mm: tuple[float, float],
    gauges: Sequence[tuple[int, int, float]],
) -> Html:
    """Isometric sketch at the isotropic posture.

    Args:
        leg_length_mm: L.
        joint_limits_mm: travel of the carriages from the isotropic posture.
        gauges: (leg, direction, place along the leg from carriage 0 to tool 1).
    """
    scale = LEG / leg_length_mm
    parts: list[Html] = []
    for leg, axis in enumerate(AXES):
        low, high = (leg_length_mm + limit for limit in joint_limits_mm)
        # Even displacements of the carriage leave the picture readable only up to here.
        end = min(high * scale, LEG + 34.0) / LEG
        start, stop = _at(leg, low * scale / LEG), _at(leg, end)
        side = 4.0 * _sideways(leg)
        joint, tool = _at(leg, 1.0), _at(leg, 0.0)
        label = _at(leg, end + 0.10) + np.array([0.0, 4.0])
        parts.append(
            tag(
                "g",
                join(
                    (
                        _line(start, stop, "rail"),
                        _line(joint + side, tool + side, "bar"),
                        _line(joint - side, tool - side, "bar"),
                        tag(
                            "rect",
                            x=joint[0] - 7,
                            y=joint[1] - 7,
                            width=14,
                            height=14,
                            rx=2,
                            class_="carriage",
                        ),
                        words(float(label[0]), float(label[1]), axis, "middle", "axis"),
                    )
                ),
                class_=f"c-{axis}",
            )
        )
    parts.append(tag("circle", cx=float(CENTRE[0]), cy=float(CENTRE[1]), r=8.0, class_="tool"))
    parts += [_gauge(*gauge) for gauge in gauges]
    placed = ", ".join(
        f"leg {AXES[leg]} in direction {AXES[direction]} at {100 * place:.0f} % of the leg"
        for leg, direction, place in gauges
    )
    return svg(
        "machine",
        WIDTH,
        HEIGHT,
        "The machine and its gauges",
        "Three legs run from the tool in the middle to carriages on the rails x, y and z."
        + (f" Gauges: {placed}." if gauges else ""),
        *parts,
    )


def _at(leg: int, fraction: float) -> Floats:
    return np.asarray(CENTRE + fraction * LEG * ON_PAPER[leg])


def _sideways(leg: int) -> Floats:
    across = np.array([-ON_PAPER[leg, 1], ON_PAPER[leg, 0]])
    return np.asarray(across / np.linalg.norm(across))


def _line(start: Floats, stop: Floats, class_: str) -> Html:
    return line(float(start[0]), float(start[1]), float(stop[0]), float(stop[1]), class_)


def _gauge(leg: int, direction: int, place: float) -> Html:
    """A dial on the side towards which its direction points: that way its reading grows."""
    touch = _at(leg, 1.0 - place)
    toward = ON_PAPER[direction] / np.linalg.norm(ON_PAPER[direction])
    dial = touch + 40.0 * toward
    x, y = float(dial[0]), float(dial[1])
    return tag(
        "g",
        _line(touch + 5.0 * toward, dial - 12.0 * toward, "plunger"),
        tag("circle", cx=x, cy=y, r=12.0, class_="dial"),
        words(x, y + 4, f"+{AXES[direction]}", "middle", "small"),
        class_=f"c-{AXES[leg]}",
    )
