"""A measured session with something hidden in it, drawn from a seed; how it goes on; its file."""

import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .effects import (
    CAUSES,
    USUAL,
    Effect,
    Times,
    contact_shift,
    draw_machine_cause,
    draw_measurement_cause,
    state_with,
    transposed,
    write_down,
)
from .forward import MACHINE_CAUSES, PARTS, Disturbance, signals
from .machines import PLACEMENT, SCALE, TOLERANCES, Gauge, Machine
from .outside import OUTSIDE
from .plan import AXIS_NAMES, SETUPS, Floats, Ints, Plan, frozen, plan_of, standard_plan

# Columns of a plan that tell where and how is read, without the clock.
SITTING = ("leg", "direction", "displacement", "gauge_at", "part", "turned", "entered")


@dataclass(frozen=True, eq=False)
class Setting:
    """What is uncertain of every session, healthy ones included, and hardly shows in it."""

    legs: Floats  # excess of the legs of a machine within its tolerance, shape (3,), [mm]
    misplaced: Floats
    """How far along the leg each set-up's gauge is from its place, one for each set-up, [mm]."""
    scale: float  # excess of the gauges' scale (1)

    @staticmethod
    def exact() -> "Setting":
        """Legs, places and scale as they should be."""
        return Setting(frozen(np.zeros(3)), frozen(np.zeros(6)), 0.0)

    @staticmethod
    def draw(rng: np.random.Generator) -> "Setting":
        """Each with the standard deviation that the machine file states or leaves to be assumed."""
        return Setting(
            frozen(rng.normal(scale=TOLERANCES["leg_length"], size=3)),
            frozen(rng.normal(scale=PLACEMENT, size=6)),
            float(rng.normal(scale=SCALE)),
        )


@dataclass(frozen=True, eq=False)
class Session:
    """Readings and the truth behind them; N readings."""

    machine: Machine
    gauge: Gauge
    plan: Plan
    offsets: Floats  # true joint offsets at the session's start, shape (3,), [mm]
    zeros: Floats  # what each set-up's gauge shows at coordinate zero, one for each set-up, [mm]
    effects: tuple[Effect, ...]
    outside: str | None  # name of an effect outside the list
    disturbance: Disturbance | None
    setting: Setting
    clean: Floats
    """The record without noise, rounding and what the setting does to it, shape (N,), [mm]."""
    readings: Floats  # the record, shape (N,), [mm]
    warm: Floats | None = None  # what a thermometer showed at each reading, shape (N,), [deg C]

    @property
    def causes(self) -> tuple[str, ...]:
        """Ids of the hidden causes; empty for a healthy session."""
        return tuple(effect.id for effect in self.effects)

    @property
    def label(self) -> str:
        """Row name in tables: `healthy`, an id, `id+id`, or `outside:name`."""
        return f"outside:{self.outside}" if self.outside else "+".join(self.causes) or "healthy"

    def gauges_show(self, plan: Plan, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Without noise, rounding and what the setting does, and with them, each (N,) [mm]."""
        state = state_with(self.offsets, self.effects)
        added = self.zeros[plan.zero] + contact_shift(plan, self.effects)
        surface = signals(plan, self.machine, state[None], self.disturbance)[0] + added
        state[PARTS["leg_length"]] += self.setting.legs
        misplaced = self.setting.misplaced
        touched = signals(plan, self.machine, state[None], self.disturbance, misplaced)[0] + added
        noise = rng.normal(scale=self.gauge.noise, size=plan.count)
        noisy = (1.0 + self.setting.scale) * touched + noise
        return surface, np.round(noisy / self.gauge.resolution) * self.gauge.resolution


def _settle_blunder(effect: Effect, shown: Floats, gauge: Gauge) -> Effect:
    """Give a misreading of digits the size that its digits imply."""
    if "digits" not in effect.extra or effect.row is None:
        return effect
    value = float(shown[effect.row])
    wrong = transposed(value, gauge.decimals, int(effect.extra["digits"]))
    size = round(wrong - value, gauge.decimals) or effect.extra["digits"] * 0.1
    return replace(effect, parameters=(size,), extra={})


def measure(
    machine: Machine,
    gauge: Gauge,
    plan: Plan,
    offsets: Floats,
    effects: tuple[Effect, ...],
    rng: np.random.Generator,
    outside: str | None = None,
    scale: float = 1.0,
    setting: Setting | None = None,
) -> Session:
    """Let a technician read the gauges of this machine along this plan.

    Args:
        offsets: true joint offsets, shape (3,), [mm].
        effects: hidden causes.
        rng: zeros, noise and what an outside effect draws.
        outside: name of an effect outside the list.
        scale: enlarges the outside effect.
        setting: exact if None.
    """
    zeros = rng.uniform(-0.25, 0.25, size=6) * gauge.range
    disturbance = OUTSIDE[outside](plan, gauge, rng, scale) if outside else None
    nothing = frozen(np.zeros(0))
    begun = Session(
        machine, gauge, plan, frozen(offsets), frozen(zeros), effects, outside, disturbance,
        setting or Setting.exact(), nothing, nothing,
    )  # fmt: skip
    surface, shown = begun.gauges_show(plan, rng)
    effects = tuple(_settle_blunder(effect, shown, gauge) for effect in effects)
    return replace(
        begun,
        effects=effects,
        clean=frozen(write_down(plan, gauge, surface, effects)),
        readings=frozen(np.round(write_down(plan, gauge, shown, effects), gauge.decimals)),
    )


def make_session(
    seed: int,
    machine: Machine,
    gauge: Gauge,
    hidden: tuple[str, ...] = (),
    outside: str | None = None,
    offset_sd: float = 0.5,
    scale: float = 1.0,
    pace: float = 0.4,
    cycles: int = 3,
    exact: bool = False,
    times: Times = USUAL,
) -> Session:
    """Draw one session. The same arguments give the same session.

    Args:
        seed: any integer >= 0.
        hidden: cause ids; empty for a healthy session.
        outside: name of an effect outside the list, from `OUTSIDE`.
        offset_sd: standard deviation of the joint offsets, [mm].
        scale: enlarges the outside effect.
        pace: mean time per posture, [min]; a slow technician sees more of what creeps.
        cycles: repeats of the three postures on each leg.
        exact: legs, places and scale as they should be; drawn otherwise.
        times: how large causes of the machine are, in tolerances.
    """
    unknown = [cause for cause in hidden if cause not in CAUSES]
    if unknown or (outside is not None and outside not in OUTSIDE):
        raise KeyError(f"no such effect: {unknown or outside}")
    words = "|".join((machine.name, gauge.name, *hidden, outside or ""))
    rng = np.random.default_rng([seed, zlib.crc32(words.encode())])
    plan = standard_plan(machine, rng, cycles, pace=pace)
    offsets = rng.normal(scale=offset_sd, size=3)
    effects = tuple(
        draw_machine_cause(cause, rng, times)
        if cause in MACHINE_CAUSES
        else draw_measurement_cause(cause, plan, rng)
        for cause in hidden
    )
    setting = Setting.draw(np.random.default_rng([seed, zlib.crc32(words.encode()), 1]))
    if "leg_length" in hidden:
        setting = replace(setting, legs=frozen(np.zeros(3)))
    if exact:
        setting = Setting.exact()
    return measure(machine, gauge, plan, offsets, effects, rng, outside, scale, setting)


def second_session(session: Session, seed: int) -> Session:
    """Another day at the same machine: offsets and the machine's causes stay, blunders do not.

    Only listed effects are carried over; each carriage starts anywhere in its lost motion again.
    """
    rng = np.random.default_rng([seed, 2])
    kept = []
    for effect in session.effects:
        if effect.id == "backlash":
            widths = np.array(effect.parameters[:3])
            lags = widths * rng.uniform(-0.5, 0.5, size=3)
            effect = replace(effect, parameters=(*effect.parameters[:3], *lags.tolist()))
        if effect.id in MACHINE_CAUSES:
            kept.append(effect)
    plan = standard_plan(session.machine, rng)
    setting = session.setting
    if np.any(setting.misplaced):
        anew = Setting.draw(np.random.default_rng([seed, 3]))
        setting = replace(setting, misplaced=anew.misplaced)
    machine, gauge, offsets = session.machine, session.gauge, session.offsets
    return measure(machine, gauge, plan, offsets, tuple(kept), rng, setting=setting)


def continue_session(
    session: Session, seed: int, *, order: Ints, hours: Floats, **columns: Ints | Floats
) -> Session:
    """The session with further readings, all on one clock and with one history of the carriages.

    The machine, its offsets and causes, the gauges and their scale stay. What happened to a gauge
    or to the record in the session goes on where its stands stay, and is over where they are set
    up again: there the gauges have zeros and places of their own.

    Args:
        session: what was measured so far, in one part or several.
        seed: of zeros, places and noise.
        order: rank in time, shape (M,); all come after those of the session.
        hours: since the session began, shape (M,), [h].
        columns: the others of SITTING, of M readings, as `Plan` has them; a part that the session
            has goes on in its set-ups.
    """
    if session.outside is not None:
        raise ValueError("what an effect outside the list does next is not known")
    new = np.argsort(order, kind="stable")
    given = columns | {"minutes": np.round(np.asarray(hours) * 60.0, 2)}
    before = session.plan
    whole = {
        name: np.concatenate((getattr(before, name), np.asarray(values)[new]))
        for name, values in given.items()
    }
    plan = plan_of(session.machine, **whole)
    asked = slice(before.count, None)

    rng = np.random.default_rng([seed, 4])
    known, setups = session.zeros.size, int(plan.zero.max()) + 1
    fresh = rng.uniform(-0.25, 0.25, size=setups - known) * session.gauge.range
    zeros = np.concatenate((session.zeros, fresh))
    setting, misplaced = session.setting, session.setting.misplaced
    places = [Setting.draw(rng).misplaced for _ in range(setups)]
    places = np.concatenate(places)[: setups - known] * bool(np.any(misplaced))
    setting = replace(setting, misplaced=frozen(np.concatenate((misplaced, places))))

    read, gauge = _really_read(session, plan), session.gauge
    joined = replace(session, plan=plan, zeros=frozen(zeros), setting=setting)
    # What is read under another label is so already.
    rest = tuple(effect for effect in session.effects if effect.id != "swapped_gauges")
    clean, readings = (
        write_down(read, gauge, values, rest)[asked] for values in joined.gauges_show(read, rng)
    )
    return replace(
        joined,
        clean=frozen(np.concatenate((session.clean, clean))),
        readings=frozen(np.concatenate((session.readings, np.round(readings, gauge.decimals)))),
    )


def again(session: Session, seed: int = 1, **changed: Any) -> Session:
    """The first sixty readings once more, an hour later; in a second part unless changed."""
    plan = session.plan
    arrays = {name: getattr(plan, name)[:60] for name in SITTING}
    arrays |= {"part": np.ones(60, dtype=int), "hours": plan.hours[:60] + plan.hours[-1] + 1.0}
    for name, value in changed.items():
        arrays[name] = np.broadcast_to(value, arrays[name].shape)
    return continue_session(session, seed, order=np.arange(60), **arrays)


def _really_read(session: Session, plan: Plan) -> Plan:
    """What was read where the gauges of a leg stay exchanged."""
    legs = [effect.leg for effect in session.effects if effect.id == "swapped_gauges"]
    exchanged = np.isin(plan.leg, legs) & (plan.part == 0)
    exchanged[: session.plan.count] = False
    rows = np.flatnonzero(exchanged)
    direction, setup, zero, stand = (
        np.array(values) for values in (plan.direction, plan.setup, plan.zero, plan.stand)
    )
    for row in rows:
        direction[row] = 3 - plan.leg[row] - plan.direction[row]
        setup[row] = SETUPS.index((int(plan.leg[row]), int(direction[row])))
        other = np.flatnonzero(
            (plan.part == 0) & (plan.setup == setup[row]) & (plan.gauge_at == plan.gauge_at[row])
        )
        zero[row], stand[row] = plan.zero[other[0]], plan.stand[other[0]]
    return replace(plan, direction=direction, setup=setup, zero=zero, stand=stand)


def readings_csv(session: Session) -> str:
    """One reading per row, in the order of time; no word of the truth."""
    plan, places = session.plan, session.gauge.decimals
    header, rows = "seq,cycle,minutes,leg,direction,posture,reading_mm", []
    header += ",temperature_c" * (session.warm is not None)
    sittings = plan.part.any() or plan.entered.any() or plan.turned.any()
    sittings = sittings or np.any(plan.gauge_at != 0.5)
    for n in range(plan.count):
        axes = f"{AXIS_NAMES[plan.leg[n]]},{AXIS_NAMES[plan.direction[n]]}"
        row = f"{n + 1},{plan.cycle[n]},{plan.minutes[n]:.2f},{axes},{plan.posture[n]}"
        row += f",{session.readings[n]:.{places}f}"
        row += "" if session.warm is None else f",{session.warm[n]:.1f}"
        if sittings:
            entered = " ".join(f"{offset:.6f}" for offset in plan.entered[n])
            bar = "turned" if plan.turned[n] else ""
            row += f",{plan.gauge_at[n]:.6f},{plan.part[n] + 1},{bar},{entered}"
        rows.append(row)
    return "\n".join((header + ",gauge_at,part,bar,entered" * bool(sittings), *rows)) + "\n"


def write_readings(session: Session, path: Path) -> Path:
    """Write the record and return its path."""
    path.write_text(readings_csv(session), encoding="utf-8")
    return path
