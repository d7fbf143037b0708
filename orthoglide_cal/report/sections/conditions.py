"""Under which conditions, with which gauges, from which data: blank where not given."""

from __future__ import annotations

from datetime import datetime

from orthoglide_cal.measured import Readings
from orthoglide_cal.outcome import Calibration, Conditions
from orthoglide_cal.report import figures
from orthoglide_cal.report.blocks import (
    Block,
    Code,
    Facts,
    Figure,
    Given,
    Line,
    Paragraph,
    Section,
    Table,
)
from orthoglide_cal.report.numbers import counted, plain

KINDS = {
    "readings": "gauge readings",
    "six": "differences, max minus min",
    "twelve": "differences relative to the isotropic posture",
    "single": "differences, tool end minus joint end",
}
_MOST_NOTES = 40


def conditions(calibration: Calibration) -> Section:
    """Conditions and gauges."""
    given = calibration.conditions
    rows: list[tuple[str, Line | None]] = [
        ("Protocol", _given(given.protocol)),
        ("Operator", _given(given.operator)),
        ("Started", moment(given.started)),
        ("Finished", moment(given.finished)),
        ("Temperature", _temperature(given)),
    ]
    rows += [
        (name.replace("_", " "), Given(text))
        for name, text in given.environment
        if name != "temperature_c"
    ]
    if calibration.session:
        rows.append(("Readings replaced", str(given.retaken)))
        rows.append(("Steps left out", str(given.skipped)))
    gauges = tuple(
        (
            Given(gauge.label),
            _given(gauge.certificate),
            None if gauge.resolution_mm is None else _short(gauge.resolution_mm),
        )
        for gauge in given.gauges
    ) or ((None, None, None),)
    stated = calibration.machine.gauge
    blocks: list[Block] = [
        Facts(tuple(rows)),
        Table(
            ("gauge", "certificate", "resolution, mm"),
            gauges,
            words=(0, 1),
            caption="Gauges that were used.",
        ),
        Paragraph(
            f"The machine file states for its gauge: resolution {_short(stated.resolution_mm)} mm,"
            f" repeatability {_short(stated.repeatability_mm)} mm (one standard deviation).",
            small=True,
        ),
    ]
    if isinstance(calibration.measured, Readings):
        blocks.append(_machine(calibration, calibration.measured))
    if given.notes:
        notes = tuple((str(line), Given(note)) for line, note in given.notes[:_MOST_NOTES])
        blocks.append(Table(("line", "note"), notes, words=(0, 1), caption="Notes at readings."))
    return Section("Conditions and gauges", tuple(blocks))


def moment(written: str | None) -> Given | None:
    """An ISO 8601 time with a blank for the "T", to the second, its zone set off."""
    if written is None:
        return None
    try:
        time = datetime.fromisoformat(written)
    except ValueError:
        return Given(written)
    zone = f" {time:%z}" if time.tzinfo else ""
    return Given(f"{time:%Y-%m-%d %H:%M:%S}{zone[:4]}{':' if zone else ''}{zone[4:6]}")


def _given(text: str | None) -> Line | None:
    return None if text is None else Given(text)


def _short(value: float) -> str:
    return f"{value:.6f}".rstrip("0").rstrip(".")


def _temperature(given: Conditions) -> Line | None:
    if given.temperature_c is not None:
        low, high = (plain(t, 1) for t in given.temperature_c)
        return f"{low} °C" if low == high else f"{low} to {high} °C"
    named = dict(given.environment).get("temperature_c")
    return None if named is None else Given(f"{named} °C")


def _machine(calibration: Calibration, readings: Readings) -> Figure:
    plan = readings.plan
    places = sorted(
        set(
            zip(
                plan.leg.tolist(),
                plan.direction.tolist(),
                [round(at, 3) for at in plan.gauge_at.tolist()],
                strict=True,
            )
        )
    )
    machine = calibration.machine
    return Figure(
        "Where the gauges stood",
        f"{counted(len(places), 'place')} on three legs; a reading grows when the leg moves"
        " towards the dial.",
        (figures.machine(machine.leg_length_mm, machine.joint_limits_mm, places),),
        columns=1,
        key="● tool, ■ carriage, double line: leg, pale line: travel of the carriage, ○ dial with"
        " the direction in which its reading grows.",
    )


def origin(calibration: Calibration) -> Section:
    """The input, the software, the numbers behind the uncertainty."""
    measured, machine = calibration.measured, calibration.machine
    identity = calibration.identity
    source = "standard input" if measured.source.path == "-" else measured.source.path
    rows: list[tuple[str, Line | None]] = [
        ("Report number", Code(identity.number)),
        ("Issued", f"{identity.issued:%Y-%m-%d %H:%M:%S} UTC"),
        ("Software", identity.software),
        ("Input", Given(source)),
        ("SHA-256 of the input", Code(measured.source.sha256)),
        ("Data", f"{len(measured)} {KINDS[measured.kind]}"),
        ("Machine", Given(machine.name)),
        (
            "Geometry",
            f"leg {machine.leg_length_mm:g} mm, travel {machine.joint_limits_mm[0]:g} to"
            f" {machine.joint_limits_mm[1]:+g} mm",
        ),
    ]
    if machine.identified:
        rows.append(("Part of the model", ", ".join(cause.id for cause in machine.identified)))
    findings = calibration.findings
    blocks: list[Block] = [Facts(tuple(rows))]
    if findings is not None:
        solution = findings.solution
        sigma = (
            ("from the residuals", solution.sigma_residuals_mm),
            ("from repeated readings", solution.sigma_repeats_mm),
            ("stated in the machine file", solution.sigma_stated_mm),
            ("floor from the resolution", solution.sigma_floor_mm),
        )
        blocks.append(
            Table(
                (f"method {solution.method}", "one reading's σ, mm"),
                tuple(
                    (name, "unknown" if value is None else plain(value, 4)) for name, value in sigma
                ),
                caption="Where the uncertainty comes from.",
            )
        )
        blocks += [Paragraph(warning, small=True) for warning in solution.warnings]
    return Section("Where this comes from", tuple(blocks))
