"""Touches of a linear delta's bed: from a CSV, or from what its printer.cfg stores."""

from __future__ import annotations

from dataclasses import replace
from pathlib import PurePath
from typing import Any

import numpy as np

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.delta_machine import CALLIPER_MM
from orthoglide_cal.files.printer_file import PrinterFile
from orthoglide_cal.files.readings import LATEST_MINUTES, check_order
from orthoglide_cal.files.table import Cells, Table
from orthoglide_cal.files.text import parse_count, unused
from orthoglide_cal.model import Floats, Gauge, Ints, Machine, Readings
from orthoglide_cal.model.kinds import DeltaMachine, LinearDelta, ProbePlan
from orthoglide_cal.model.kinds.layouts import MINUTES_PER_TOUCH
from orthoglide_cal.model.machine import trilaterate

PLACE_COLUMNS = ("x_mm", "y_mm")
PROBE_COLUMNS = (*PLACE_COLUMNS, "reading_mm", "z_mm", "seq", "cycle", "minutes", "note")
# What no printer.cfg states: a probe repeats within a hundredth.
REPEATABILITY_MM = 0.012


def probe_readings_from_table(table: Table, machine: DeltaMachine) -> Readings:
    """The touches of a CSV. Raises InvalidFileError with everything that is wrong."""
    faults = table.faults
    for name in (*PLACE_COLUMNS, "reading_mm"):
        if name not in table.columns:
            remedy = table.other_unit(name) or "Give x_mm, y_mm and reading_mm for each touch."
            faults.add(f"The column {name} is missing.", remedy, line=table.header_line)
    table.check_split_numbers(("reading_mm",), PROBE_COLUMNS[:-1])
    faults.check()
    if not table.rows:
        faults.add("There is no reading.", "Give one row for each touch, under the header.")
    cells = Cells(table.rows, faults, table.number)
    wide, high = 2.0 * machine.bed_radius_mm, max(machine.arm_lengths_mm)
    wanted, arm = "Give it, or remove the row.", "an arm is long"
    x, y = (
        cells.lengths(name, wide, "coordinate", wanted, "the bed is wide") for name in PLACE_COLUMNS
    )
    reading = cells.lengths("reading_mm", high, "height", wanted, arm)
    surface = np.nan_to_num(cells.lengths("z_mm", high, "height", than=arm), nan=0.0)
    minutes = cells.numbers("minutes", 0.0, LATEST_MINUTES)
    seq = cells.read("seq", lambda text: parse_count(text, 0), -1)
    cycle = cells.read("cycle", lambda text: parse_count(text, 1), 1)
    cells.check_complete(("seq", "minutes"))
    check_order(cells, seq, minutes, "minutes")
    _check_places(cells, x, y, machine)
    faults.check()
    timed = "minutes" in table.rows[0].cells
    place = np.column_stack((x, y, reading))
    order = np.argsort(np.argsort(seq, kind="stable"))
    plan = _plan(machine, place, surface, order, minutes if timed else None)
    unknown = (name for name in table.columns if name not in PROBE_COLUMNS)
    return Readings(
        plan=plan,
        value=reading - surface,
        cycle=np.array(cycle),
        note=tuple(row.cells.get("note", "") for row in table.rows),
        line=np.array([row.line for row in table.rows]),
        timed=timed,
        source=table.document.source,
        remarks=tuple(unused("Columns", unknown, PROBE_COLUMNS)),
        **_nothing(len(plan)),
    )


def places_csv(plan: ProbePlan) -> str:
    """The touches of a plan as a file to be filled in: their places, and no reading yet."""
    rows = [
        f"{x:g},{y:g},{high:g},"
        for (x, y, _), high, apart in zip(
            plan.place.tolist(), plan.surface.tolist(), plan.distance.tolist(), strict=True
        )
        if not apart
    ]
    return "\n".join((",".join((*PLACE_COLUMNS, "z_mm", "reading_mm")), *rows)) + "\n"


def touches_csv(readings: Readings) -> str:
    """Touches as a CSV that can be read again."""
    plan = readings.plan
    columns = (plan.order + 1, 60.0 * plan.hours, *plan.place.T[:2], plan.surface, readings.value)
    rows = [
        f"{number},{minutes:.2f},{x:g},{y:g},{z:g},{value + z:.6f}"
        for number, minutes, x, y, z, value in zip(*(c.tolist() for c in columns), strict=True)
    ]
    return "\n".join(("seq,minutes,x_mm,y_mm,z_mm,reading_mm", *rows)) + "\n"


def _check_places(cells: Cells, x: Floats, y: Floats, machine: DeltaMachine) -> None:
    for index, away in enumerate(np.hypot(x, y).tolist()):
        if away > 1.2 * machine.bed_radius_mm:
            cells.note(
                index,
                "x_mm",
                f"The place is {away:.0f} mm from the middle of the bed.",
                f"Check it, or bed_radius_mm ({machine.bed_radius_mm:g}) in the machine file.",
            )


def machine_of_printer(file: PrinterFile, known: Machine | None = None) -> DeltaMachine:
    """The machine with the parameters that a printer.cfg has in force.

    Args:
        file: as read.
        known: what else is known of it; None stands for what is usual.
    """
    stated: dict[str, Any] = {
        "leg_length_mm": float(file.arms.mean()),
        "offsets_mm": tuple(file.endstops.tolist()),
        "arm_lengths_mm": tuple(file.arms.tolist()),
        "delta_radius_mm": file.radius,
        "tower_angles_deg": tuple(file.angles.tolist()),
        "bed_radius_mm": file.print_radius,
        "workspace_mm": 2.0 * file.print_radius,
        "joint_limits_mm": (-float(file.endstops.max()), 0.0),
    }
    if isinstance(known, DeltaMachine):
        return replace(known, **stated)
    return DeltaMachine(
        name=PurePath(file.source.path).name,
        kind=LinearDelta.id,
        parallelogram_width_mm=0.0,
        tool_offset_mm=0.0,
        gauge=Gauge(0.0, float(file.arms.max()), None, REPEATABILITY_MM),
        calliper_mm=CALLIPER_MM,
        **stated,
    )


def printer_readings(file: PrinterFile, stored: str | None, machine: DeltaMachine) -> Readings:
    """What a printer.cfg stores, as readings.

    Args:
        file: as read.
        stored: "calibration" or "mesh"; None for the calibration where there is one, else the
            mesh.
        machine: by whose parameters the places are meant.

    Raises:
        InputError: it does not store that.
    """
    chosen = stored or ("mesh" if file.heights is None else "calibration")
    return (_mesh if chosen == "mesh" else _calibration)(file, machine)


def _mesh(file: PrinterFile, machine: DeltaMachine) -> Readings:
    mesh = file.mesh
    if mesh is None:
        raise InputError(
            "The file stores no mesh.",
            "Run BED_MESH_CALIBRATE and SAVE_CONFIG, or take --data calibration.",
            file=file.source.path,
        )
    n, height = len(mesh.x), file.probe[2]
    place = np.column_stack((mesh.x, mesh.y, mesh.height + height))
    left_out = (
        f"{mesh.padded} points of the mesh {mesh.profile!r} were not probed: they repeat a"
        " neighbour and are left out."
    )
    return Readings(
        plan=_plan(machine, place, np.full(n, height), mesh.order, None),
        value=mesh.height,
        cycle=np.ones(n, dtype=np.intp),
        note=("",) * n,
        line=mesh.line,
        timed=False,
        source=file.source,
        remarks=(*file.remarks, *([left_out] if mesh.padded else [])),
        **_nothing(n),
    )


def _calibration(file: PrinterFile, machine: DeltaMachine) -> Readings:
    """Heights and distances, at the places where the machine's parameters put the nozzle."""
    heights, distances = file.heights, file.distances
    if heights is None:
        raise InputError(
            "The file stores no probed heights.",
            "Run DELTA_CALIBRATE and SAVE_CONFIG, or take --data mesh.",
            file=file.source.path,
        )
    rails = LinearDelta().rails(machine)

    def reached(carriages: Floats) -> Floats:
        return np.asarray(trilaterate(rails.carriages(carriages), rails.lengths))

    place, surface = reached(heights.carriages), heights.height
    other, value, line = place, place[:, 2] - surface, heights.line
    if distances is not None:
        first, second = reached(distances.first), reached(distances.second)
        wanted = np.linalg.norm(second - first, axis=1)
        place, other = np.vstack((place, first)), np.vstack((other, second))
        value = np.concatenate((value, distances.distance - wanted))
        line = np.concatenate((line, distances.line))
    plan = _plan(machine, place, surface, np.arange(len(place)), None, other)
    n = len(plan)
    return Readings(
        plan=plan,
        value=value,
        cycle=np.ones(n, dtype=np.intp),
        note=("",) * n,
        line=line,
        timed=False,
        source=file.source,
        remarks=file.remarks,
        **_nothing(n),
    )


def _plan(
    machine: DeltaMachine,
    place: Floats,
    surface: Floats,
    order: Ints,
    minutes: Floats | None,
    other: Floats | None = None,
) -> ProbePlan:
    """Touches of surfaces, (t,) [mm], and behind them the distances to other places (n, 3)."""
    n, touches = len(place), len(surface)
    clock = np.asarray(MINUTES_PER_TOUCH * order if minutes is None else minutes, np.float64)
    distance = np.arange(n) >= touches
    return ProbePlan(
        order=order,
        hours=clock / 60.0,
        place=place,
        other=place if other is None else other,
        surface=np.concatenate((surface, np.zeros(n - touches))),
        distance=distance,
        weight=np.where(distance, machine.gauge.noise_mm / machine.calliper_mm, 1.0),
    )


def _nothing(count: int) -> dict[str, Any]:
    """What readings of gauges have beside and touches have not."""
    return {
        "posture": ("",) * count,
        "temperature": np.full(count, np.nan),
        "gauge": ("",) * count,
    }
