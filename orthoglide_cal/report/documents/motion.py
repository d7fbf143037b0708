"""The machine in its postures, its errors enlarged: a picture to move, and a table of the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orthoglide_cal.model import AXES, Floats, Machine
from orthoglide_cal.model.workspace import Travel
from orthoglide_cal.report import document as doc
from orthoglide_cal.report import views
from orthoglide_cal.report.words import signed, two_figures

WHEN = ("before", "after")
ENLARGED = (0, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
LARGEST = 50.0  # the largest error is drawn about as long [mm of the machine]


def motion(found: Travel, machine: Machine) -> doc.Section:
    """What the controller believes and what is, through the travel of each leg."""
    real = {"before": found.before_mm, "after": found.after_mm}
    largest = max(float(_distance(places, found).max()) for places in real.values())
    fitting = [k for k, factor in enumerate(ENLARGED) if factor * largest <= LARGEST]
    start = {"posture": 0, "enlarged": fitting[-1]}
    factor, names = ENLARGED[start["enlarged"]], _postures(found)
    shown = found.nominal_mm[0] + factor * (found.before_mm[0] - found.nominal_mm[0])
    axes = views.axes_on_paper(machine.leg_length_mm)
    rails = views.rail_ends(machine.leg_length_mm, machine.joint_limits_mm)
    data = {
        "names": list(AXES),
        "when": list(WHEN),
        "enlarged": list(ENLARGED),
        "start": start,
        "centre": views.CENTRE.tolist(),
        "axes": axes.tolist(),
        "rails": rails.tolist(),
        "frames": [
            {
                "posture": name,
                "nominal": found.nominal_mm[k].round(4).tolist(),
                **{when: places[k].round(4).tolist() for when, places in real.items()},
            }
            for k, name in enumerate(names)
        ],
    }
    finding = f"{names[0]}, before the adjustment; errors are drawn {factor} times as large."
    figure = doc.Figure(
        None,
        "Pale: where the controller believes carriages and tool to be. Strong: where they are.",
        (views.moved(found.nominal_mm[0], shown, rails, axes, finding),),
        columns=1,
        motion=data,
    )
    return doc.Section("The machine in motion", (figure, _table(found, names)))


def _distance(real: Floats, found: Travel) -> Floats:
    """Of the real tool from where it is believed to be, shape (m,) [mm]."""
    return np.asarray(np.linalg.norm((real - found.nominal_mm)[:, 3], axis=-1))


def _postures(found: Travel) -> list[str]:
    return [
        f"leg {AXES[leg]} at {signed(place, 0)} mm"
        for leg, place in zip(found.leg.tolist(), found.displacement_mm.tolist(), strict=True)
    ]


def _table(found: Travel, names: Sequence[str]) -> doc.Grid:
    """The same as numbers, at the ends of each leg's travel and in its middle."""
    chosen = [
        k
        for leg in range(3)
        for mine in [np.flatnonzero(found.leg == leg)]
        for k in (mine[0], mine[np.argmin(np.abs(found.displacement_mm[mine]))], mine[-1])
    ]
    sizes = [_distance(places, found) for places in (found.before_mm, found.after_mm)]
    return doc.Grid(
        ("posture", *WHEN),
        tuple((names[k], *(two_figures(float(size[k])) for size in sizes)) for k in chosen),
        caption="Distance of the tool from where the controller believes it to be, mm; after the"
        " adjustment without what the uncertainty of the offsets leaves.",
    )
