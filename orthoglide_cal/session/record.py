"""A session's state as the session file that every command reads."""

from __future__ import annotations

from collections.abc import Sequence

from orthoglide_cal.axes import AXES
from orthoglide_cal.data import SessionRecord, session_readings
from orthoglide_cal.data.machine_schema import MachineModel
from orthoglide_cal.machine import Machine
from orthoglide_cal.measured import Readings, Source
from orthoglide_cal.session.events import Questioned, Taken
from orthoglide_cal.session.state import Accepted, State
from orthoglide_cal.session.steps import Step


def readings(state: State, steps: Sequence[Step], machine: Machine, path: str) -> Readings:
    """The readings so far, as they will be read from the session file at the end."""
    return session_readings(session_record(state, steps, machine), Source(path, ""))


def session_record(state: State, steps: Sequence[Step], machine: Machine) -> SessionRecord:
    """The session file's content; the same records always give the same content."""
    opened = state.opened
    numbered = {step.number: step for step in steps}
    taken = [
        {**_reading(state, steps, numbered[number], item), "seq": seq}
        for seq, (number, item) in enumerate(state.in_time(), start=1)
    ]
    retaken = [
        {**_values(state, numbered[old.take.step], old.take), "reason": old.reason}
        for old in state.replaced
    ]
    return SessionRecord.model_validate(
        {
            "schema_version": 1,
            "machine": MachineModel.from_machine(machine).model_dump(),
            "protocol": opened.protocol,
            "operator": opened.operator or None,
            "gauges": [
                {
                    "id": gauge["id"],
                    "certificate": gauge["certificate"] or None,
                    "resolution": machine.gauge.resolution_mm,
                }
                for gauge in opened.gauges
            ],
            "started": opened.at,
            "finished": state.ended.at if state.ended else None,
            "environment": _environment(state),
            "readings": taken,
            "retaken": retaken,
            "skipped": [
                {**_place(numbered[number]), "reason": reason}
                for number, reason in sorted(state.skipped.items())
            ],
        }
    )


def segment(state: State, steps: Sequence[Step], step: Step, rank: int) -> int | None:
    """The step at which this gauge's stand last stood elsewhere before `rank`; None if never."""
    if not state.moved:
        return None
    numbered = {item.number: item for item in steps}
    moved = [
        number
        for number, at in state.moved
        if at <= rank and numbered[number].series == step.series
    ]
    return moved[-1] if moved else None


def _place(step: Step) -> dict[str, object]:
    return {
        "leg": AXES[step.leg],
        "posture": step.posture,
        "direction": AXES[step.direction],
        "end": step.end or None,
        "cycle": step.cycle,
    }


def _values(state: State, step: Step, take: Taken) -> dict[str, object]:
    gauges = state.opened.gauges
    return {
        **_place(step),
        "reading_mm": take.value_mm,
        "minutes": round(take.minutes, 4),
        "temperature_c": state.opened.temperature_c,
        "gauge": gauges[step.stand]["id"] if step.stand < len(gauges) else "",
        "timestamp": take.at,
        "note": take.remark,
    }


def _reading(state: State, steps: Sequence[Step], step: Step, item: Accepted) -> dict[str, object]:
    values = _values(state, step, item.take)
    remarks = [item.take.remark]
    if isinstance(item.take, Questioned):
        remarks.append(f"kept although questioned: {item.take.question}")
    remarks += [text for number, text in state.notes if number == step.number]
    values["note"] = "; ".join(remark for remark in remarks if remark)
    moved = segment(state, steps, step, item.rank)
    if moved is not None:
        # Another label is another set-up: the moved gauge has a zero of its own.
        values["gauge"] = f"{values['gauge']} (moved at step {moved})".strip()
    return values


def _environment(state: State) -> dict[str, str]:
    opened = state.opened
    said = {"readings_from": ", ".join(state.source)}
    if opened.seed is not None:
        said["seed"] = str(opened.seed)
    if opened.temperature_c is not None:
        said["temperature_c"] = f"{opened.temperature_c:g}"
    loose = [
        f"step {number}: {text}" for number, text in state.notes if number not in state.accepted
    ]
    if loose:
        said["notes"] = "; ".join(loose)
    return said
