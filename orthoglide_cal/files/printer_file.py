"""Klipper's printer.cfg as it stands to the parameters in force and what it stores of probing.

Of a linear delta only: sections [printer], [stepper_a … c], [probe], [delta_calibrate] and
[bed_mesh]. Included files are not opened. Options, units and defaults: Klipper's documents
"Configuration reference", "Delta calibration" and "Bed Mesh".
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath

import numpy as np

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.printer_settings import LARGEST_MM, Settings, Value, within
from orthoglide_cal.files.text import FileText
from orthoglide_cal.model import Floats, Source
from orthoglide_cal.model.linear_delta import (
    TOWERS_TURN,
    Endstops,
    LinearDelta,
    Probe,
    counter_clockwise,
)
from orthoglide_cal.model.plan import Bools, Ints, ReadOnly
from orthoglide_cal.model.probe_plan import MINUTES_PER_TOUCH, ProbePlan

_TOWERS = ("stepper_a", "stepper_b", "stepper_c")
# Where the towers a, b, c of all firmwares stand before any correction, counter-clockwise from x.
USUAL_ANGLES_DEG = (210.0, 330.0, 90.0)
# Probes that read while they move.
_SCANNING = re.compile("scanner|cartographer|beacon|idm|probe_eddy_current .+")
# Klipper's own, those of its descendants, and scanners that come with a module of their own.
_PROBE = re.compile(
    "probe|bltouch|smart_effector|load_cell_probe|dockable_probe|probe_eddy_current .+"
    "|scanner|cartographer|beacon|idm"
)
_CALIBRATION = "delta_calibrate"
_STORED = re.compile("(?:manual_)?height[0-9]|distance[0-9]")
_PROFILE = "bed_mesh "
_MATTERS = re.compile(
    rf"printer|{'|'.join(_TOWERS)}|{_CALIBRATION}|bed_mesh|{_PROFILE}.*|{_PROBE.pattern}"
)
# Of [bed_mesh]: the place at which the height of the mesh is set to zero.
_ZEROS = ("zero_reference_position", "relative_reference_index")

# What no printer.cfg states: a probe repeats within a hundredth.
REPEATABILITY_MM = 0.012
_AGAIN = "Probe the bed and save the mesh again."
ZERO_UNKNOWN = (
    "it cannot show the common height of the three endstops. Set the height of the nozzle again"
    " after entering them."
)
# DELTA_CALIBRATE leaves stored heights right on the mean.
_TRIMMED_MM = 0.02
_ROUNDED = 0.01  # mm, to which the spacing of a mesh is rounded down


@dataclass(frozen=True)
class Stored(ReadOnly):
    """Touches, and distances on a printed object, that a file stores; n readings.

    Attributes:
        plan: with the places where the controller believes the nozzle to be.
        value: as of `Readings`, shape (n,) [mm]; NaN where no arms reach.
        line: in the file, shape (n,).
        mesh: its name; None for heights that are stored with the positions of the carriages.
        remarks: what to know about it.
    """

    plan: ProbePlan
    value: Floats
    line: Ints
    mesh: str | None = None
    remarks: tuple[str, ...] = ()

    @classmethod
    def of_touches(cls, mesh: str, touches: Sequence[Sequence[float]], trigger: float) -> Stored:
        """From line, x, y and height of each, in the order of time; at least one.

        Heights are those of the nozzle over where it is when the probe triggers, `trigger` [mm].
        """
        line, x, y, height = np.array(touches).T
        place = np.column_stack((x, y, height + trigger))
        plan = touching(place, np.full(len(line), trigger), np.arange(len(line)))
        return cls(plan, height, line.astype(int), mesh)

    @classmethod
    def of_grid(
        cls, mesh: str, x: Floats, y: Floats, height: Floats, line: Sequence[int], offset: Floats
    ) -> Stored:
        """From rows of heights, shape (m, n) [mm]; NaN where nothing was probed.

        The first row was probed in the direction of +x, the second of -x, and so on.

        Args:
            x, y: places of the probe, shapes (n,) and (m,) [mm].
            height, line: of each row.
            offset: of the probe from the nozzle, shape (3,) [mm].
        """
        probed = np.isfinite(height)
        turn = np.arange(probed.size).reshape(probed.shape)
        turn[1::2] = turn[1::2, ::-1].copy()
        at, along = (place[probed] for place in np.meshgrid(x, y))
        order = np.argsort(np.argsort(turn[probed]))
        lines = np.repeat(line, len(x)).reshape(probed.shape)[probed]
        place = np.column_stack((at - offset[0], along - offset[1], height[probed] + offset[2]))
        plan = touching(place, np.full(len(place), offset[2]), order)
        return cls(plan, height[probed], lines, mesh)


def touching(
    place: Floats,
    surface: Floats,
    order: Ints,
    minutes: Floats | None = None,
    other: Floats | None = None,
) -> ProbePlan:
    """Touches of surfaces, (t,) [mm], and behind them the distances to other places (n, 3).

    All are as precise as each other.
    """
    n, touches = len(place), len(surface)
    clock = np.asarray(MINUTES_PER_TOUCH * order if minutes is None else minutes, np.float64)
    return ProbePlan(
        order=order,
        hours=clock / 60.0,
        place=place,
        other=place if other is None else other,
        surface=np.concatenate((surface, np.zeros(n - touches))),
        distance=np.arange(n) >= touches,
        weight=np.ones(n),
    )


@dataclass(frozen=True)
class PrinterFile(ReadOnly):
    """What files of a firmware state and store of a linear delta.

    Attributes:
        machine: with the parameters in force, and what is usual else.
        probe: what is added to the nozzle's place to have the probe's, shape (3,) [mm]; x, y, and
            the nozzle's height when the probe triggers. NaN where it is not known.
        heights, mesh: what is stored; None where there is nothing. Heights have the distances
            behind them.
        remarks: what to know about it, but for its mesh.
        firmware: as an export names it.
    """

    machine: LinearDelta
    probe: Floats
    source: Source
    heights: Stored | None = None
    mesh: Stored | None = None
    remarks: tuple[str, ...] = ()
    firmware: str = "klipper"


def read_printer_file(
    document: FileText, calibration: Mapping[str, Value] | None = None
) -> PrinterFile:
    """What a printer.cfg says; `calibration` stands for the options of its [delta_calibrate].

    Raises InvalidFileError with everything that is wrong in the lines that matter here.
    """
    settings = Settings(document, _MATTERS.fullmatch)
    settings.faults.check()  # what follows from a broken line is no fault of its own
    if calibration is not None:
        kept = {key: value for key, value in settings.options.items() if key[0] != _CALIBRATION}
        named = {(_CALIBRATION, option): value for option, value in calibration.items()}
        settings.options = {**kept, **named}
    _check_kind(settings)
    radius = settings.number("printer", "delta_radius", low=0.0)
    arms = _each(settings, "arm_length", 0.0 if math.isnan(radius) else radius)
    endstops = _each(settings, "position_endstop", -LARGEST_MM)
    angles = [
        settings.number(tower, "angle", default, low=-720.0)
        for tower, default in zip(_TOWERS, USUAL_ANGLES_DEG, strict=True)
    ]
    # The arms reach downwards only if the towers follow each other in one sense.
    if not any(map(math.isnan, angles)) and not counter_clockwise(angles):
        given = (settings.options.get((tower, "angle")) for tower in _TOWERS)
        towers = ", ".join(f"[{tower}]" for tower in _TOWERS)
        remedy = f"Check the angles of {towers}; they are usually near 210, 330 and 90."
        line = max(value.line for value in given if value is not None)
        settings.faults.add(TOWERS_TURN, remedy, line=line, column="angle")
    print_radius = settings.number("printer", "print_radius", radius, low=0.0)
    sensor = next(filter(_PROBE.fullmatch, settings.sections), "probe")
    probe = np.array([settings.number(sensor, f"{axis}_offset", 0.0) for axis in "xyz"])
    home = endstops + np.sqrt(np.maximum(np.square(arms) - radius**2, 0.0))
    # A file that stores no steps need not say how long they are.
    stored = any(map(_STORED.match, settings.options_of(_CALIBRATION)))
    step = np.array([_step(settings, tower) if stored else 0.0 for tower in _TOWERS])
    heights = _calibration(settings, home, step, ("height", "manual_height"), ("_pos", "_pos"))
    distances = _calibration(settings, home, step, ("distance",), ("_pos1", "_pos2"))
    mesh = _mesh(settings, sensor, probe)
    settings.faults.check()
    scanning = _SCANNING.fullmatch(sensor) is not None
    machine = delta_of(document, arms, radius, np.array(angles), endstops, print_radius, scanning)
    return PrinterFile(
        machine,
        probe,
        document.source,
        heights=_reached(machine, heights, distances),
        mesh=mesh,
        remarks=tuple(settings.remarks),
    )


def delta_of(
    document: FileText,
    arms: Floats,
    radius: float,
    angles: Floats,
    endstops: Floats,
    bed: float,
    scanning: bool = False,
) -> LinearDelta:
    """A machine with these parameters in force, [mm, deg]; arrays are of shape (3,).

    It has the name of its file; what a file says is checked by whoever reads it.
    """
    return LinearDelta.model_construct(
        name=PurePath(document.path).name,
        arm_length_mm=tuple(arms.tolist()),
        delta_radius_mm=radius,
        tower_angles_deg=tuple(angles.tolist()),
        endstops_mm=Endstops(*endstops.tolist()),
        bed_radius_mm=bed,
        probe=Probe(resolution_mm=0.0, repeatability_mm=REPEATABILITY_MM, scanning=scanning),
    )


def _check_kind(settings: Settings) -> None:
    """Raises for a machine of another kind, or a file of something else."""
    kind = settings.options.get(("printer", "kinematics"))
    if kind and kind.text.lower() != "delta":
        what = "The machine is not a linear delta."
        settings.note("printer", "kinematics", what, "Give a delta's file.")
        raise settings.faults.error()
    if not kind and not {"printer", *_TOWERS} & set(settings.sections):
        what = "The file does not describe a linear delta: it has no [printer] and no [stepper_a]."
        remedy = "Give the printer.cfg of a delta."
        if settings.included:
            remedy = "Copy [printer] and [stepper_a … c] from the included files into this one."
        raise InputError(what, remedy, file=settings.faults.file)
    if not kind:
        settings.missing("printer", "kinematics")


def _each(settings: Settings, option: str, low: float) -> Floats:
    """A number of each tower; that of the first stands for the others where they have none."""
    first = settings.number(_TOWERS[0], option, low=low)
    others = (settings.number(tower, option, first, low) for tower in _TOWERS[1:])
    return np.array((first, *others))


def _step(settings: Settings, tower: str) -> float:
    """Way of a carriage with one step [mm]."""
    turn, old = "rotation_distance", "step_distance"  # the latter until 2021
    if (tower, turn) not in settings.options and (tower, old) in settings.options:
        return settings.number(tower, old, low=0.0)
    way = settings.number(tower, turn, low=0.0)
    steps = settings.count(tower, "full_steps_per_rotation", 200)
    steps *= settings.count(tower, "microsteps")
    return way / (max(steps, 1) * settings.read(tower, "gear_ratio", _gears, math.nan, 1.0))


def _calibration(
    settings: Settings, home: Floats, step: Floats, names: Sequence[str], ends: tuple[str, str]
) -> list[Floats]:
    """What [delta_calibrate] stores under these names, n values.

    Returns:
        Heights of the carriage joints over the bed at both ends of a distance, the same twice of a
        height, shapes (n, 3) [mm]; the probe's offset, a height that was entered by hand, or the
        distance that callipers showed [mm]; and the line of each.
    """
    pattern = re.compile(rf"(({'|'.join(names)})([0-9]{{1,6}}))(?:{'|'.join(('', *ends))})")
    options = settings.options_of(_CALIBRATION)
    found: dict[tuple[int, int, str], int] = {}
    for option, value in options.items():
        if match := pattern.fullmatch(option):
            found.setdefault((names.index(match[2]), int(match[3]), match[1]), value.line)
    lines = {key[-1]: found[key] for key in sorted(found)}
    low = 0.0 if names == ("distance",) else -LARGEST_MM
    values = [settings.number(_CALIBRATION, stem, math.nan, low) for stem in lines]
    for stem, line in lines.items():
        if stem not in options:
            settings.missing(_CALIBRATION, stem, line)
            continue
        for end in dict.fromkeys(ends):
            if stem + end not in options:
                what = f"{stem} has no stepper positions: {stem}{end} is missing."
                remedy = "Run DELTA_CALIBRATE and SAVE_CONFIG again, or remove the line."
                settings.note(_CALIBRATION, stem, what, remedy)
    nothing = [math.nan] * len(_TOWERS)
    steps = (
        [settings.read(_CALIBRATION, stem + end, _three, nothing, nothing) for stem in lines]
        for end in ends
    )
    carriages = (home - np.reshape(each, (-1, 3)) * step for each in steps)
    return [*carriages, np.array(values), np.array(list(lines.values()))]


def _reached(machine: LinearDelta, *stored: Sequence[Floats]) -> Stored | None:
    """Heights and distances, at the places where the machine's parameters put the nozzle."""
    rails, known = machine.nominal_rails, stored[0][2]
    if not len(known):
        return None
    first, second, value, line = map(np.concatenate, zip(*stored, strict=True))
    place, other = (np.asarray(rails.tool_for(at, strict=False)) for at in (first, second))
    plan = touching(place, known, np.arange(len(value)), other=other)
    value = np.where(plan.distance, value - plan.wanted, place[:, 2] - value)
    trimmed = float(np.mean(value[: len(known)]))
    remark = (
        f"The settings in force put the nozzle {abs(trimmed):.3f} mm"
        f" {'higher' if trimmed > 0.0 else 'lower'} than it was stored at. If the endstops"
        " were changed after DELTA_CALIBRATE, as for a first layer, entering the result"
        " removes that: set the height of the nozzle again afterwards."
    )
    remarks = (remark,) if abs(trimmed) > _TRIMMED_MM else ()
    return Stored(plan, value, line.astype(int), remarks=remarks)


def _mesh(settings: Settings, sensor: str, probe: Floats) -> Stored | None:
    profiles = [name for name in settings.sections if name.startswith(_PROFILE)]
    if not profiles:
        return None
    section = next((name for name in profiles if name == f"{_PROFILE}default"), profiles[0])
    profile = section.removeprefix(_PROFILE).strip()
    remarks = [*_mesh_remarks(settings, sensor, section)]
    if len(profiles) > 1:
        remarks.append(
            f"Of {len(profiles)} stored meshes, {profile!r} was taken. To take another, name it"
            " [bed_mesh default] in a copy of the file."
        )
    x, y = (_grid(settings, section, axis) for axis in "xy")
    lines, rows = _rows(settings, section, len(x), len(y))
    stated = settings.number("bed_mesh", "mesh_radius", 0.0, low=0.0)
    if settings.faults:
        return None
    probed = _probed(*np.meshgrid(x, y), rows, stated)
    # Old versions stored the offsets with the mesh, and the places of the nozzle.
    offset = probe * (0.0, 0.0, 1.0) if (section, "x_offset") in settings.options else probe
    if padded := int(np.sum(~probed)):
        remarks.append(
            f"{padded} points of the mesh {profile!r} were not probed: they repeat a neighbour and"
            " are left out."
        )
    mesh = Stored.of_grid(profile, x, y, np.where(probed, rows, math.nan), lines, offset)
    return replace(mesh, remarks=tuple(remarks))


def _mesh_remarks(settings: Settings, sensor: str, section: str) -> Iterator[str]:
    """What to know about the places, the heights and the age of a mesh."""
    unstated = [axis for axis in ("x_offset", "y_offset") if (sensor, axis) not in settings.options]
    if settings.included and unstated:
        yield (
            f"{' and '.join(unstated)} of [{sensor}] taken as 0: the file does not state it. If an"
            f" included file does, copy its [{sensor}] into this one."
        )
    for option in _ZEROS:
        if ("bed_mesh", option) in settings.options:
            yield (
                f"By line {settings.options['bed_mesh', option].line}, {option}, the mesh counts"
                f" from one of its own places: {ZERO_UNKNOWN}"
            )
    # SAVE_CONFIG moves what DELTA_CALIBRATE found to the end; a mesh keeps its place.
    mesh = settings.options.get((section, "points"))
    stored = settings.options_of(_CALIBRATION).items()
    first = min((value.line for option, value in stored if _STORED.match(option)), default=0)
    if mesh and first > mesh.line:
        yield (
            f"The calibration (line {first}) was stored after this mesh was saved first (line"
            f" {mesh.line}). If BED_MESH_CALIBRATE was not run again since then, the mesh is older"
            " than the calibration in force: the result is wrong."
        )


def _grid(settings: Settings, section: str, axis: str) -> Floats:
    """The places of a mesh along one axis [mm]; empty if they cannot be read."""
    low, high = (settings.number(section, f"{end}_{axis}") for end in ("min", "max"))
    count = settings.count(section, f"{axis}_count")
    if low >= high:
        settings.note(section, f"max_{axis}", "The mesh ends before it begins.", _AGAIN)
    return np.linspace(low, high, count)


def _rows(settings: Settings, section: str, across: int, along: int) -> tuple[list[int], Floats]:
    """Line of each row of a mesh, and the heights, shape (along, across)."""
    points = settings.options.get((section, "points"))
    if points is None:
        settings.missing(section, "points")
        return [], np.empty((0, 0))
    rows = []
    for line, text in points.texts:
        cells = text.split(",")
        if across and len(cells) != across:
            what = f"The row of the mesh has {len(cells)} heights, x_count says {across}."
            settings.note(section, "points", what, _AGAIN, line)
            continue
        try:
            rows.append([within(cell, -LARGEST_MM) for cell in cells])
        except InputError as error:
            settings.note(section, "points", error.what, error.remedy, line, error.value or "")
    if along and len(points.texts) != along:
        what = f"The mesh has {len(points.texts)} rows, y_count says {along}."
        settings.note(section, "points", what, _AGAIN, points.line)
    return [line for line, _ in points.texts], np.array([] if settings.faults else rows)


def _probed(x: Floats, y: Floats, height: Floats, stated: float) -> Bools:
    """Which points of a mesh were probed, shape as the others.

    On a round bed only those in the circle are; the rest of each row repeats its outermost one.
    The circle is the mesh radius about the middle; a mesh was not always taken with the radius that
    the file states now: where the two do not fit together, its own width decides, and whether the
    values repeat.
    """
    away = np.hypot(x - x.mean(), y - y.mean())
    width = np.ptp(x) / 2.0
    fits = -_ROUNDED <= stated - width <= _ROUNDED * x.shape[1]
    inside = away <= (stated if fits else width) + _ROUNDED

    def repeats(row: Floats, kept: Bools) -> bool:
        """Whether the rest of a row repeats the outermost of those kept."""
        places = np.flatnonzero(kept)
        if not places.size:
            return False
        first, last = places[0], places[-1]
        return bool(np.all(row[:first] == row[first]) and np.all(row[last:] == row[last]))

    return inside if fits or all(map(repeats, height, inside)) else np.ones_like(inside)


def _three(text: str) -> list[float]:
    """Stepper positions of the towers."""
    parts = text.split(",")
    if len(parts) != len(_TOWERS):
        raise InputError("These are not three stepper positions.", "Write a,b,c: one per tower.")
    return [within(part, -1e8, 1e8) for part in parts]


def _gears(text: str) -> float:
    """The turns of the motor for one of the pulley: "5:1, 80:16" is 25."""
    ratio = 1.0
    for pair in text.split(","):
        teeth = pair.split(":")
        if len(teeth) != 2:
            raise InputError("This is not a gear ratio.", "Write 5:1, or 5:1, 80:16.")
        ratio *= within(teeth[0], 0.0) / within(teeth[1], 0.0)
    return ratio
