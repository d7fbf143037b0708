"""More readings at the same machine, in any plan: the sitting goes on, or another one follows."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .effects import write_down
from .machines import Machine
from .plan import SETUPS, Floats, Ints, Plan, frozen, joints_at
from .session import Session, Setting

SITTING = ("leg", "direction", "displacement", "gauge_at", "part", "turned", "entered")


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
    added = {name: np.asarray(values)[new] for name, values in given.items()}
    plan = _appended(session.plan, session.machine, added)
    asked = slice(session.plan.count, None)

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


def _appended(plan: Plan, machine: Machine, added: dict[str, Any]) -> Plan:
    """The plan with further rows in the order of time."""
    whole = {name: np.concatenate((getattr(plan, name), rows)) for name, rows in added.items()}
    rows = list(zip(whole["leg"].tolist(), whole["displacement"].tolist(), strict=True))
    indicated = np.array([joints_at(machine.leg, leg, moved) for leg, moved in rows])
    names_of = {0.0: "iso", machine.upper: "max", machine.lower: "min"}
    posture = tuple(names_of.get(moved, f"{moved:g}") for _, moved in rows)
    zero, stand = _set_ups(whole)
    seen: Counter[object] = Counter()
    cycle = []
    for key in zip(whole["part"], whole["leg"], whole["direction"], posture, strict=True):
        seen[key] += 1
        cycle.append(seen[key])
    pairs = zip(whole["leg"].tolist(), whole["direction"].tolist(), strict=True)
    approach = _approach(indicated - whole["entered"])
    approach[: plan.count] = plan.approach
    setup = [SETUPS.index(pair) for pair in pairs]
    return Plan.of(
        posture=posture, cycle=cycle, indicated=indicated, approach=approach, setup=setup,
        zero=zero, stand=stand, **whole,
    )  # fmt: skip


def _set_ups(whole: dict[str, Any]) -> tuple[list[int], list[int]]:
    """Number and first row of each row's set-up."""
    columns = [whole[name].tolist() for name in ("part", "leg", "direction", "gauge_at")]
    keys = list(zip(*columns, strict=True))
    number = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    return [number[key] for key in keys], [keys.index(key) for key in keys]


def _approach(scales: Floats) -> Floats:
    """Sign of each carriage's last motion by its own scale, 0 before its first, shape (N, 3)."""
    signs: list[Sequence[float]] = [np.zeros(3)]
    for move in np.diff(scales, axis=0):
        signs.append(np.where(move == 0.0, signs[-1], np.sign(move)))
    return np.array(signs)


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
