"""What is left of each reading, as pictures in characters or colours, by how it was measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from orthoglide_cal.diagnosis import Diagnosis
from orthoglide_cal.estimation.accuracy import rms
from orthoglide_cal.model import Contact, Differences, Floats, Ints, Readings, Series, View
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.bed import colours, limits_of, sign, signs
from orthoglide_cal.report.facts import comparison_words, end_words
from orthoglide_cal.words import counted, plain, signed

BED_LEGEND = (
    "The bed from above, y upwards: + the probe triggered too high, − too low. In characters:"
    " · noise, + − over 2σ, ▲ ▼ over 4σ."
)
# More signs than this would not fit beside a name: the largest deviations of each stand for all.
_SIGNS = 30


def residual_pictures(diagnosis: Diagnosis, fit: tuple[doc.Block, ...]) -> tuple[doc.Section, ...]:
    """Measured minus predicted, without and with the accepted causes.

    Args:
        diagnosis: of any data.
        fit: says whether the calibrated parameters suffice; comes last.
    """
    measured = diagnosis.measured
    if isinstance(measured, Differences):
        return (doc.Section("Differences, mm", (_differences(measured, diagnosis), *fit)),)
    models = {f"{diagnosis.model.machine.vocabulary.many} only": diagnosis.nominal_mm}
    if diagnosis.causes:
        names = " and ".join(cause.id for cause in diagnosis.causes)
        models[f"with {names}"] = diagnosis.explained_mm
    left = {name: diagnosis.measured_mm - predicted for name, predicted in models.items()}
    draw, legend = _VIEWS[measured.view]
    drawn = draw(measured, left, diagnosis.lack_of_fit.noise_mm)
    sections = (
        doc.Section(f"Measured minus predicted, µm: {name}", blocks)
        for name, blocks in zip(models, drawn, strict=True)
    )
    return (*sections, doc.Section(None, (doc.Paragraph(legend, small=True), *fit)))


def _by_leg(
    measured: Readings, left: Mapping[str, Floats], sigma: float
) -> Iterator[tuple[doc.Block, ...]]:
    """A table of signs by leg and posture for each model."""
    for residual in left.values():
        yield (_residuals(measured, residual, sigma),)


def bed_maps(
    measured: Readings, left: Mapping[str, Floats], sigma: float
) -> Iterator[tuple[doc.Block, ...]]:
    """A map of the bed for each model, and what is left of the distances.

    Args:
        measured: touches, and distances.
        left: name of a model → measured − predicted, shape (n,) [mm].
        sigma: standard deviation of one touch [mm].
    """
    plan = measured.plan
    touched, place = ~plan.distance, plan.place[:, :2]
    heights = np.unique(plan.surface[touched]).tolist()
    limits = limits_of(*(values[touched] for values in left.values()))
    for number, (name, values) in enumerate(left.items()):
        blocks: list[doc.Block] = []
        for height in heights:
            own = touched & (plan.surface == height)
            size = 1000.0 * rms(values[own])
            at = f"{name}, at {height:g} mm" if len(heights) > 1 else name
            finding = f"{plain(size, 1)} µm r.m.s. at {counted(int(own.sum()), 'touch')}"
            panel = f"bed-{number}-{len(blocks)}"
            figure = doc.Figure(
                at if len(heights) > 1 else None,
                f"{finding}.".replace("touchs", "touches"),
                (colours(panel, at, place[own], values[own], limits),),
                sketch=signs(place[own], values[own], sigma),
                columns=2,
            )
            blocks.append(figure)
        if plan.distance.any():
            apart = 1000.0 * values[plan.distance]
            blocks.append(
                doc.Paragraph(
                    f"{apart.size} distances: {plain(rms(apart), 0)} µm r.m.s., at most"
                    f" {plain(float(np.abs(apart).max()), 0)} µm."
                )
            )
        yield tuple(blocks)


def _differences(measured: Differences, diagnosis: Diagnosis) -> doc.Grid:
    """One row per difference: measured, predicted, left without and with the causes [mm]."""
    columns = {
        "measured": diagnosis.measured_mm,
        "predicted by offsets": diagnosis.nominal_mm,
        "left": diagnosis.measured_mm - diagnosis.nominal_mm,
    }
    if diagnosis.causes:
        head = "left with the cause" + "s" * (len(diagnosis.causes) > 1)
        columns[head] = diagnosis.measured_mm - diagnosis.explained_mm
    rows = (
        (each.name, *(signed(float(values[k]), 3) for values in columns.values()))
        for k, each in enumerate(measured.which)
    )
    return doc.Grid(("", *columns), tuple(rows), caption=comparison_words(measured.which)[1])


def _residuals(measured: Readings, residual: Floats, sigma: float) -> doc.Grid:
    """One row per series, one column per posture.

    Args:
        measured: n readings.
        residual: measured − predicted, shape (n,) [mm].
        sigma: standard deviation of one reading [mm].
    """
    postures = list(dict.fromkeys(measured.posture))
    columns: list[list[str]] = [[] for _ in postures]
    names = []
    for name, own in _series(measured):
        names.append(name)
        in_time = own[np.argsort(measured.plan.order[own], kind="stable")]
        for posture, column in zip(postures, columns, strict=True):
            chosen = [k for k in in_time if measured.posture[k] == posture]
            column.append(_mean_and_signs(residual[chosen], sigma))
    for column in columns:
        # Signs begin below each other, however many repeats there are.
        longest = max(len(cell.partition(" ")[2]) for cell in column)
        column[:] = [cell + " " * (longest - len(cell.partition(" ")[2])) for cell in column]
    return doc.Grid(("leg, direction", *postures), tuple(zip(names, *columns, strict=True)))


def _series(measured: Readings) -> Iterator[tuple[str, Ints]]:
    """Readings of one leg, direction, leg end, gauge place and part: its name, which they are."""
    plan = measured.plan
    several = np.unique(plan.gauge_at).size > 1
    keys = np.stack((plan.leg, plan.direction, plan.contact, plan.gauge_at, plan.part), axis=1)
    for key in np.unique(keys, axis=0):
        name, contact = Series(int(key[0]), int(key[1])).words, Contact(int(key[2]))
        if contact.end:
            name += end_words(contact.end)
        elif several:
            name += f", at {key[3]:g}"
        if plan.parts > 1:
            name += f", part {key[4] + 1:.0f}"
        yield name, np.flatnonzero(np.all(keys == key, axis=1))


def _mean_and_signs(residual: Floats, sigma: float) -> str:
    """The mean over the repeats [µm] and a sign for each, in order of time."""
    if not residual.size:
        return ""
    parts = np.array_split(residual, min(residual.size, _SIGNS))
    marks = "".join(sign(float(part[np.argmax(np.abs(part))]), sigma) for part in parts)
    return f"{signed(1000.0 * float(residual.mean()), 1)} {marks}"


# How readings were taken → how what is left of them is drawn, and what the signs mean.
_VIEWS = {
    View.LEGS: (
        _by_leg,
        "Mean of the repeats, then one sign for each: · noise, + − over 2σ, ▲ ▼ over 4σ.",
    ),
    View.BED: (bed_maps, BED_LEGEND),
}
