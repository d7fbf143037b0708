"""One input of a report: what was measured, on which machine, under which conditions."""

from __future__ import annotations

from dataclasses import dataclass

from orthoglide_cal.data.document import YAML_LIMIT, check_size, read_document
from orthoglide_cal.data.measured_file import input_from_document, is_yaml
from orthoglide_cal.data.schema import check_tree
from orthoglide_cal.data.session_file import readings_from_tree
from orthoglide_cal.data.session_schema import SessionRecord
from orthoglide_cal.data.yaml_tree import load_tree
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Measured, Readings


@dataclass(frozen=True)
class GaugeIdentity:
    """A gauge as given; None where not given."""

    label: str
    certificate: str | None = None
    resolution_mm: float | None = None


@dataclass(frozen=True)
class Conditions:
    """Circumstances as recorded; None or empty where not given, never invented.

    Attributes:
        protocol, operator, started, finished: as in the session file.
        temperature_c: lowest and highest reading of the thermometer.
        environment: further remarks, name → text.
        gauges: those of the session, or the labels in the readings.
        retaken: number of readings that were replaced.
        skipped: number of steps left out.
        notes: (line of the file, remark).
    """

    protocol: str | None = None
    operator: str | None = None
    started: str | None = None
    finished: str | None = None
    temperature_c: tuple[float, float] | None = None
    environment: tuple[tuple[str, str], ...] = ()
    gauges: tuple[GaugeIdentity, ...] = ()
    retaken: int = 0
    skipped: int = 0
    notes: tuple[tuple[int, str], ...] = ()


@dataclass(frozen=True, eq=False)
class Case:
    """An input with its machine and conditions; `session` tells a session from a table."""

    measured: Measured
    machine: Machine
    conditions: Conditions
    session: bool


def read_case(path: str, machine: Machine | None = None) -> Case:
    """Read a CSV or session, each byte once.

    Args:
        path: as the user gave it; "-" is standard input.
        machine: None for the one in the session, or the prototype.

    Raises:
        InvalidFileError, InputError: as `data.read_input`.
    """
    document = read_document(path)
    if not is_yaml(document):
        measured, judge = input_from_document(document, machine)
        return Case(measured, judge, _conditions(measured, None), False)
    check_size(document.size, path, YAML_LIMIT)
    tree = load_tree(document)
    readings, judge = readings_from_tree(tree, machine)
    record = check_tree(SessionRecord, tree)
    return Case(readings, judge, _conditions(readings, record), True)


def _conditions(measured: Measured, record: SessionRecord | None) -> Conditions:
    temperature: tuple[float, float] | None = None
    labels: tuple[str, ...] = ()
    notes: tuple[tuple[int, str], ...] = ()
    if isinstance(measured, Readings):
        known = [t for t in measured.temperature.tolist() if t == t]
        temperature = (min(known), max(known)) if known else None
        labels = tuple(dict.fromkeys(label for label in measured.gauge if label))
        notes = tuple(
            (line, note)
            for line, note in zip(measured.line.tolist(), measured.note, strict=True)
            if note
        )
    if record is None:
        gauges = tuple(GaugeIdentity(label) for label in labels)
        return Conditions(temperature_c=temperature, gauges=gauges, notes=notes)
    known_ids = {gauge.id for gauge in record.gauges}
    return Conditions(
        protocol=record.protocol or None,
        operator=record.operator or None,
        started=record.started or None,
        finished=record.finished or None,
        temperature_c=temperature,
        environment=tuple(
            (name, text) for name, text in (record.environment or {}).items() if text
        ),
        gauges=(
            *(GaugeIdentity(g.id, g.certificate or None, g.resolution) for g in record.gauges),
            *(GaugeIdentity(label) for label in labels if label not in known_ids),
        ),
        retaken=len(record.retaken),
        skipped=len(record.skipped),
        notes=notes,
    )
