"""What goes to the controller, in its formats, and the words that go with it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from orthoglide_cal.errors import command, file_words, visible
from orthoglide_cal.estimation import PromisedDifference, stays
from orthoglide_cal.estimation.accuracy import rms
from orthoglide_cal.files import Conditions
from orthoglide_cal.files.table import csv_text
from orthoglide_cal.model import AXES, Model, Source
from orthoglide_cal.model.workspace import Compensation
from orthoglide_cal.report.escape import in_csv
from orthoglide_cal.report.json import SCHEMA_VERSION, fields_of
from orthoglide_cal.results import (
    Adjustment,
    Calibration,
    CheckPosture,
    Export,
    Recording,
    Remedy,
    recording,
)
from orthoglide_cal.words import coverage_words, plain, short, signed, two_figures, with_uncertainty

# Instead of "may be entered", where there is nothing to change.
SETTLED = "Nothing to enter: the firmware has these values, as well as these readings know them"
FORCED = "FORCED: this result must not be used."
_COMPENSATION_DECIMALS = 4  # tenths of a micrometre
_TAKING_METHODS = ("solve", "report", "export")


def check_words(check: CheckPosture) -> str:
    """The check posture as an instruction, without the number that is expected."""
    series = check.difference.series
    leg, direction = AXES[series.leg], AXES[series.direction]
    if check.ends:
        return (
            f"Check: drive to {_position(check.first)}. Read the height of leg {leg} along"
            f" {direction} at the joint end, then at the tool end. The second reading minus"
            " the first should be"
        )
    return (
        f"Check: put the gauge at the middle of leg {leg}, along {direction}. Read it"
        f" at {_position(check.first)}, then at {_position(check.second)}. The second reading minus"
        " the first should be"
    )


def _position(tool: Sequence[float]) -> str:
    """ "X60 Y0 Z0": a tool position as it is typed."""
    return " ".join(f"{a.upper()}{short(value, 3)}" for a, value in zip(AXES, tool, strict=True))


def expected(check: CheckPosture) -> str:
    """The number that the check should give, with its tolerance."""
    return f"{with_uncertainty(check.expected_mm, check.tolerance_mm)} mm"


def about(
    verb: str, source: Source, *others: str, machine: Path | None = None, options: str = ""
) -> str:
    """A command about what was read of a file, with what was chosen of it, and other files."""
    chosen = f"--data {source.excerpt.data}" if source.excerpt else ""
    given = f"{chosen} {options}".strip()
    return command(verb, source.path, *others, machine=machine, options=given)


def follow_up(
    verb: str, calibration: Calibration, machine_file: Path | None, options: str = ""
) -> str:
    """A command about the same input, with what was given for it, and further options."""
    solution = calibration.solution
    if solution is not None and verb in _TAKING_METHODS:
        chosen = "" if solution.method_is_default else f"--method {solution.method}"
        options = f"{chosen} {options}".strip()
    return about(verb, calibration.input.measured.source, machine=machine_file, options=options)


def verify_command(
    calibration: Calibration, adjustment: Adjustment, machine_file: Path | None
) -> str:
    """What to type once the offsets were entered and the session was measured again.

    With what was entered, where no machine file can tell.
    """
    applied = " ".join(plain(change, adjustment.decimals) for change in adjustment.applied_mm)
    before = calibration.input.measured.source
    recorded = adjustment.machine.recorded
    unknown = recorded and recording(calibration.input) is Recording.NOWHERE
    options = f"--applied {applied}" if unknown else ""
    return about("verify", before, "AFTER", machine=machine_file, options=options)


def record_command(calibration: Calibration, machine_file: Path | None) -> str | None:
    """What to type once the offsets were entered; None where that is recorded, or nowhere kept."""
    if recording(calibration.input) is not Recording.DUE:
        return None
    return follow_up("apply", calibration, machine_file)


def table_command(calibration: Calibration, machine_file: Path | None) -> str | None:
    """What to type for a table that takes out what offsets leave; None where none would."""
    adjustment, model = calibration.adjustment, calibration.input.model
    if adjustment is None or not stays(adjustment.promised):
        return None
    if not any(effect.cause.compensable for effect in model.accepted):
        return None
    return follow_up("export", calibration, machine_file, "--format table")


def remainder(promised: Sequence[PromisedDifference], model: Model) -> str | None:
    """What offsets do not remove, in a sentence; None where nothing but noise is left."""
    if not stays(promised):
        return None
    left = two_figures(rms(np.array([row.expected_mm for row in promised])))
    causes = " and ".join(effect.cause.id for effect in model.accepted)
    return f"Offsets do not remove {causes or 'this'}: {left} mm r.m.s. is left after correction."


def cautions(calibration: Calibration) -> tuple[str, ...]:
    """What to know although the offsets may be entered."""
    told, adjustment = calibration.release.cautions, calibration.adjustment
    left = remainder(adjustment.promised, calibration.model) if adjustment else None
    return told if left is None else (left, *told)


def measure_again(conditions: Conditions | None) -> str:
    """What to type to measure again: a simulated machine comes back with its seed."""
    seed = dict(conditions.environment).get("seed") if conditions else None
    options = f"--gauge simulated --seed {seed}" if seed and seed.isdecimal() else ""
    return command("measure", options=options)


def remedy_command(
    remedy: Remedy, calibration: Calibration, machine_file: Path | None
) -> str | None:
    """What to type about this file; None where there is nothing to type."""
    if remedy.verb is None:
        return None
    return follow_up(remedy.verb, calibration, machine_file, remedy.options)


def remedy_words(calibration: Calibration, machine_file: Path | None) -> list[str]:
    """What to do instead of entering the offsets, each in one line with what to type."""
    remedies = calibration.release.remedies
    typed = (remedy_command(remedy, calibration, machine_file) for remedy in remedies)
    return [
        f"{remedy.sentence} {line or ''}".rstrip()
        for remedy, line in zip(remedies, typed, strict=True)
    ]


def head(export: Export) -> list[str]:
    """Title, origin, and the warning of a forced export."""
    found = export.calibration
    identity, source = found.identity, found.input.measured.source
    lines = [
        f"{export.adjustment.machine.vocabulary.title} for {found.input.model.machine.name},"
        f" {identity.number}",
        f"Issued {identity.issued:%Y-%m-%d %H:%M} UTC by {identity.software}",
        f"From {file_words(source.path)}, SHA-256 {source.sha256}",
    ]
    if export.forced:
        lines += [FORCED, *export.forced]
    notes = (f"{SETTLED}.", *cautions(found)) if found.settled else cautions(found)
    return lines + [f"Note: {line}" for line in notes]


def after_entering(export: Export, machine_file: Path | None) -> list[str]:
    """Re-home, check posture, verification."""
    restart = export.adjustment.machine.vocabulary.restart
    lines = [f"After entering: {restart[0].lower()}{restart[1:]}"]
    check = export.adjustment.check
    if check is not None:
        before = f"(before: {signed(check.before_mm, 2)} mm)"
        lines.append(f"{check_words(check)} {expected(check)} {before}.")
    record = record_command(export.calibration, machine_file)
    if record is not None:
        lines.append(f"Record what was entered: {record}")
    table = table_command(export.calibration, machine_file)
    if table is not None:
        lines.append(f"What offsets leave, a table of corrections takes out: {table}")
    verify = verify_command(export.calibration, export.adjustment, machine_file)
    lines.append(f"Then measure again and run: {verify}")
    return lines


def as_text(export: Export, machine_file: Path | None = None) -> str:
    """A page of plain text for any controller: "the controller says X, truly Y"."""
    adjustment, says = export.adjustment, export.calibration.input.model.machine.leg_length_mm
    decimals, absolute = adjustment.decimals, adjustment.machine.absolute
    value = plain if absolute else signed
    rows = [("parameter" if absolute else "axis", "previous", "change", "U", "enter")] + [
        (
            f"{joint.axis}, {joint.unit}" if absolute else joint.axis,
            value(joint.previous_mm, decimals),
            signed(joint.change_mm, decimals) if joint.determined else "unknown",
            two_figures(joint.expanded_mm),
            value(joint.new_mm, decimals),
        )
        for joint in adjustment.joints
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    meaning = (
        f"Parameters ({adjustment.machine.vocabulary.relation};"
        if absolute
        else "Joint offsets, mm (true joint position = indicated + offset;"
    )
    lines = [
        *map(visible, head(export)),
        "",
        f"{meaning} U: expanded uncertainty,"
        f" {coverage_words(adjustment.budget.k)}, {100 * adjustment.confidence:.0f} %)",
        *("  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in rows),
        "",
    ]
    if not absolute:
        lines += [
            "At the isotropic posture, as the controller is set now:",
            *(
                f"{joint.axis}: the controller says {plain(says, decimals)} mm,"
                f" truly {plain(says + joint.change_mm, decimals)} mm"
                for joint in adjustment.joints
            ),
            "",
        ]
    lines += map(visible, after_entering(export, machine_file))
    return "\n".join(lines) + "\n"


def as_linuxcnc(export: Export, machine_file: Path | None = None) -> str:
    """Comments and one [JOINT_n] section per axis; true position = indicated + HOME_OFFSET.

    To be pasted by hand: the configuration itself is never rewritten, because its repeated keys
    and comments would not survive.
    """
    decimals = export.adjustment.decimals
    lines = [f"# {visible(line)}" for line in head(export)]
    lines += [
        "#",
        "# HOME_OFFSET takes the joint offset with its sign, in mm (divide by 25.4 if LINEAR_UNITS",
        "# is inch). If yours holds more than the offset, such as the place of the home switch,",
        "# add the change to it instead of replacing it.",
    ]
    for number, joint in enumerate(export.adjustment.joints):
        lines += [
            "",
            f"[JOINT_{number}]",
            f"# axis {joint.axis}: previous {signed(joint.previous_mm, decimals)},"
            f" change {signed(joint.change_mm, decimals)} (U = {two_figures(joint.expanded_mm)})",
            f"HOME_OFFSET = {plain(joint.new_mm, decimals)}",
        ]
    lines.append("")
    lines += [f"# {visible(line)}" for line in after_entering(export, machine_file)]
    return "\n".join(lines) + "\n"


def _values(export: Export, machine_file: Path | None) -> dict[str, Any]:
    """Plain values; lengths in mm."""
    found, adjustment = export.calibration, export.adjustment
    return {
        "schema_version": SCHEMA_VERSION,
        "number": found.identity.number,
        "issued": found.identity.issued.isoformat(timespec="seconds"),
        "software": found.identity.software,
        "input": fields_of(found.input.measured.source, "path", "sha256"),
        "machine": found.input.model.machine.name,
        "status": export.status,
        "forced": bool(export.forced),
        "reasons_against": list(export.forced),
        "cautions": list(cautions(found)),
        "parameters" if adjustment.machine.absolute else "joints": joints_data(adjustment),
        "coverage_factor": adjustment.budget.k,
        "confidence": adjustment.confidence,
        "rehome": True,
        "check": _check_values(adjustment.check) if adjustment.check else None,
        "instructions": after_entering(export, machine_file),
    }


def joints_data(adjustment: Adjustment) -> dict[str, Any]:
    """What to enter; parameters that are no joint offsets with their units."""
    if adjustment.machine.absolute:
        every = {
            joint.axis: {
                "unit": joint.unit,
                "previous": joint.previous_mm,
                "change": joint.change_mm if joint.determined else None,
                "new": joint.new_mm,
                "expanded_uncertainty": joint.expanded_mm,
                "determined": joint.determined,
            }
            for joint in adjustment.joints
        }
        return every
    return {
        joint.axis: {
            **fields_of(joint, "previous_mm", "change_mm", "new_mm"),
            "expanded_uncertainty_mm": joint.expanded_mm,
        }
        for joint in adjustment.joints
    }


def _check_values(check: CheckPosture) -> dict[str, Any]:
    series = check.difference.series
    return {
        "difference": check.difference.name,
        "leg": AXES[series.leg],
        "direction": AXES[series.direction],
        "first_tool_mm": list(check.first),
        "second_tool_mm": list(check.second),
        "first_joints_mm": list(check.first_joints),
        "second_joints_mm": list(check.second_joints),
        **fields_of(check, "before_mm", "expected_mm", "tolerance_mm"),
    }


def as_json(export: Export, machine_file: Path | None = None) -> str:
    """One JSON object on one line."""
    return json.dumps(_values(export, machine_file), allow_nan=False, ensure_ascii=True) + "\n"


def as_yaml(export: Export, machine_file: Path | None = None) -> str:
    """A YAML document; a forced one says so in its first line."""
    import yaml

    body: str = yaml.safe_dump(
        _values(export, machine_file), sort_keys=False, allow_unicode=False, width=1000
    )
    return (f"# {FORCED}\n" if export.forced else "") + body


def as_csv(export: Export) -> str:
    """One row per joint; what the export is stands in every row."""
    found, adjustment = export.calibration, export.adjustment
    decimals, source = adjustment.decimals, found.input.measured.source
    # Of parameters in several units the columns have none in their names.
    unit, name = ("", "parameter") if adjustment.machine.absolute else ("_mm", "axis")
    rows = [
        {
            name: joint.axis,
            **({} if unit else {"unit": joint.unit}),
            f"previous{unit}": plain(joint.previous_mm, decimals),
            f"change{unit}": plain(joint.change_mm, decimals) if joint.determined else "",
            f"new{unit}": plain(joint.new_mm, decimals),
            f"expanded_uncertainty{unit}": plain(joint.expanded_mm, decimals + 1),
            "coverage_factor": plain(adjustment.budget.k, 3),
            "confidence": f"{adjustment.confidence:g}",
            "status": export.status,
            "reasons_against": in_csv(" ".join(export.forced)),
            "rehome": "yes",
            "machine": in_csv(found.input.model.machine.name),
            "number": found.identity.number,
            "input": in_csv(source.path),
            "input_sha256": source.sha256,
        }
        for joint in adjustment.joints
    ]
    return csv_text(list(rows[0]), (row.values() for row in rows))


def as_table(table: Compensation, export: Export) -> str:
    """One row per grid point: where the tool is wanted, and what to add to the joint values."""
    head = (
        *(f"{axis}_mm" for axis in AXES),
        *(f"add_to_joint_{axis}_mm" for axis in AXES),
        *("status", "causes", "not_compensated", "number"),
    )
    causes, left_out = " ".join(table.causes), " ".join(table.left_out)
    stamp = (export.status, causes, left_out, export.calibration.identity.number)
    values = np.hstack((table.points_mm, table.corrections_mm)).tolist()
    return csv_text(
        head, ((*(plain(v, _COMPENSATION_DECIMALS) for v in row), *stamp) for row in values)
    )
