"""`orthocal simulate`: synthetic sessions of any machine."""

from __future__ import annotations

import secrets
from typing import TYPE_CHECKING

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import LARGEST, Count, File, Number, Offsets, Texts, option
from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.schema import parse_number
from orthoglide_cal.words import counted

if TYPE_CHECKING:
    import numpy as np

    from orthoglide_cal.model.machine import Machine
    from orthoglide_cal.model.model import Effect
    from orthoglide_cal.model.plan import Plan


def simulate(
    protocol: common.Protocol = common.PROTOCOL,
    offsets: Offsets = option("DX DY DZ", "True joint offsets, mm. Default: 0 0 0."),
    noise: Number = option(
        "MM", "Standard deviation of a reading. Default: that of the machine's gauge.", min=0.0
    ),
    resolution: Number = option(
        "MM", "Resolution of the gauge; 0: none. Default: that of the machine's gauge.", min=0.0
    ),
    cycles: Count = option(
        "N", "Number of cycles, 1 to 1000. Default: 3; on a printer 1.", min=1, max=1000
    ),
    gauge_at: Number = option(
        "SHARE",
        "Gauge position along the leg, 0 (carriage joint) to 1 (tool). Default: 0.5."
        " Double-posture only.",
        min=0.0,
        max=1.0,
    ),
    places: Count = option(
        "N", "Linear delta: places on its bed, 1 to 2000. Default: 41.", min=1, max=2000
    ),
    height: list[float] | None = option(
        "MM", "Linear delta: height of the block under the probe. Give it again for more."
    ),
    radius_angles: Offsets = option(
        "DR DA DB",
        "Linear delta: errors of its radius, mm, and of the angles of towers a and b, deg."
        " --offsets are the errors of its endstops.",
    ),
    cause: Texts = option(
        "ID=VALUES",
        "Cause to hide in the session, such as axis_gap=0.1,0.2,-0.1 or misread=0.1, whose"
        " place is random. May be repeated.",
    ),
    seed: Count = option("N", "Whole number; the same one gives the same session.", min=0),
    target: File = common.OUTPUT,
    machine: File = common.MACHINE,
    json: bool = common.JSON,
) -> None:
    """Simulate readings as a technician would write them, as CSV.

    --output FILE.yaml and --json give a session.
    """
    import numpy as np

    from orthoglide_cal.files.readings import (
        probe_points_csv,
        readings_csv,
        session_json,
        session_of_readings,
        session_text,
    )
    from orthoglide_cal.model.machine import SimulationOptions
    from orthoglide_cal.model.model import synthetic_session

    chosen = secrets.randbelow(2**32) if seed is None else seed
    known = common.usual_machine(machine)
    nominal = known.machine
    given = {"repeatability_mm": noise, "resolution_mm": resolution}
    gauge = nominal.instrument.changed(**{k: v for k, v in given.items() if v is not None})
    rng = np.random.default_rng(chosen)
    yaml = target is not None and target.suffix.lower() in (".yaml", ".yml")
    wanted = SimulationOptions(cycles, protocol, gauge_at, places, height, radius_angles)
    plan = nominal.simulated_plan(wanted)
    on_bed = plan.touches.any()
    if on_bed and (json or yaml):
        raise UsageError("Touches are written as CSV only.", "Name a file that ends in .csv.")
    true = np.zeros(len(nominal.parameter_names))
    true[:3], true[3:] = offsets or 0.0, radius_angles or 0.0
    effects = [_effect_named(text, plan, nominal, rng) for text in cause or ()]
    # What the controller corrects of a cause acts on a hidden one, too.
    wrong = known.extended(effects).correcting(nominal.corrected)
    made = synthetic_session(wrong, plan, true, rng, gauge)
    rows = "touches" if on_bed else "readings"
    text = probe_points_csv(made) if on_bed else readings_csv(made)
    if json or yaml:
        record = session_of_readings(made, known, {"source": f"simulated, seed {chosen}"})
        text = session_text(record) if yaml else text
    if target or not json:
        common.put(text, target, f"{len(made)} {rows} written to {target}")
    if json:
        common.put(common.json_line(session_json(record)))
    if seed is None:
        common.tell(f"seed {chosen}")


def _effect_named(text: str, plan: Plan, machine: Machine, rng: np.random.Generator) -> Effect:
    """The effect that `--cause ID=VALUES` describes (`orthocal guide simulate`).

    Its place is random, and what nobody can type (where a carriage with lost motion stands first).
    Raises UsageError: it cannot act here, or not as described.
    """
    import numpy as np

    from orthoglide_cal.causes import CAUSES

    id, _, sizes = text.partition("=")
    possible = [id for id, cause in CAUSES.items() if cause.usual(machine) is not None]
    if id not in possible:
        fault = f"A machine of kind {machine.kind} has no cause {id!r}."
        raise UsageError(fault, f"Choose one of {', '.join(possible)}.")
    cause = CAUSES[id]
    names = list(machine.named(cause.names).values())
    try:
        values = [parse_number(part) for part in sizes.split(",")] if sizes.strip() else []
    except InputError as error:
        fault = f"--cause {id}: {error.what} ({error.value!r})"
        raise UsageError(fault, error.remedy) from error
    if len(values) != len(names) and not (cause.shares and 0 < len(values) < len(names)):
        wants = counted(len(names), "value") + (f" in {cause.unit}" if cause.unit else "")
        fault = f"--cause {id} takes {wants if names else 'no value'}, not {len(values)}."
        wanted = f"{id}={','.join(names)}, a number for each name" if names else f"--cause {id}"
        raise UsageError(fault, f"Write {wanted}.")
    low = 0.0 if cause.positive else -LARGEST
    if any(not low <= value <= LARGEST for value in values):
        remedy = f"Give numbers from {low:g} to {LARGEST:g}."
        raise UsageError(f"{id} cannot have this size.", remedy)
    places = [p for p in cause.places(plan, machine) if cause.reversible(plan, p)]
    if not places:
        raise UsageError(f"{id} cannot act in this session.", "Choose another protocol.")
    # The last terms of a shape may be left out.
    values += [0.0] * (len(names) - len(values))
    hidden = rng.normal(0.0, cause.prior_std(machine)[len(names) :])
    # The noise stays that of the session without the cause.
    place = places[rng.spawn(1)[0].integers(len(places))]
    if where := cause.label(place, plan, machine):
        common.tell(f"{id}: {where}")
    return cause.at(np.concatenate([np.array(values) * cause.scale, hidden]), place)
