"""A model: a machine with what is known to be wrong with it, and what every gauge reads on it.

A reading is made in four stages, and whatever is wrong with it acts in exactly one of them:

    geometry   where the rails and legs are            a_i, u_i, L_i
    motion     where the carriages really stand        q = ρ + Δρ
    contact    what the gauge touches                  Table 2, eqs. (18)–(24)
    record     what was written down

Predicted readings are those of gauges whose zero is the frame's origin; each real gauge adds
its own unknown zero, which the estimation removes.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from orthoglide_cal.model.cause import Cause, Effect, Estimate, Stage
from orthoglide_cal.model.kinematics import RealMachine
from orthoglide_cal.model.machine import Corrections, Instrument, Machine
from orthoglide_cal.model.measured import Readings
from orthoglide_cal.model.plan import Floats, Numbers, Plan


@dataclass(frozen=True, eq=False)
class Model:
    """A machine and its accepted causes."""

    machine: Machine  # nominal; the controller computes its commands from it
    accepted: tuple[Effect, ...] = ()  # what it leaves out, applied in this order in each stage
    ruled_out: tuple[str, ...] = ()  # ids of causes that were looked at by hand and are not there

    def extended(self, effects: Iterable[Effect]) -> "Model":
        """The model with more causes, after those that it has."""
        return replace(self, accepted=(*self.accepted, *effects))

    def holding(self, active: Sequence[float], corrected: Corrections | None = None) -> "Model":
        """`Machine.holding`; other corrections, too, where they are given."""
        held = replace(self, machine=self.machine.holding(active))
        return held if corrected is None else held.correcting(corrected)

    def correcting(self, corrected: Corrections) -> "Model":
        """The model with these corrections in force in the controller of its machine.

        What of an accepted cause the controller corrects acts on the joints with opposite sign.
        Where a cause is not accepted, the correction is taken to remove it.
        """
        accepted = tuple(effect for effect in self.accepted if not effect.corrects)
        known = {effect.cause.id: effect.cause for effect in accepted}
        opposite = tuple(
            cause.correcting(self.machine, corrected[id])
            for id, cause in known.items()
            if id in corrected
        )
        machine = self.machine.changed(corrected=corrected)
        return replace(self, machine=machine, accepted=accepted + opposite)

    def accepting(self, effect: Effect) -> "Model":
        """The model with a cause of which readings showed what its controller leaves."""
        total = replace(effect, theta=self.total(effect))
        return self.extended([total]).correcting(self.machine.corrected)

    def total(self, effect: Effect) -> Floats:
        """Parameters (p,) with what the controller corrects, of which readings show the rest."""
        cause, corrected = effect.cause, self.machine.corrected
        if cause.id not in corrected or cause.id in {other.cause.id for other in self.accepted}:
            return effect.theta
        return effect.theta - cause.correcting(self.machine, corrected[cause.id]).theta

    def remaining(self) -> tuple[Effect, ...]:
        """The accepted causes, less what the controller corrects of them; one effect each."""
        left: dict[str, Effect] = {}
        for effect in self.accepted:
            known = left.get(effect.cause.id)
            left[effect.cause.id] = (
                replace(known, theta=known.theta + effect.theta) if known else effect
            )
        return tuple(left.values())

    def judging(self, then: "Model") -> "Model":
        """`Machine.judging`, with the causes that are known now."""
        machine = self.machine.judging(then.machine)
        accepted = tuple(effect.transferred(self.machine, machine) for effect in self.accepted)
        return replace(self, machine=machine, accepted=accepted)

    def called(self, effect: Effect) -> tuple[Estimate, ...]:
        """Parameters of an effect with the names that they have on this kind of machine."""
        names = self.machine.named(effect.cause.names)
        return tuple(one.changed(name=names[one.name]) for one in effect.estimates)

    @cached_property
    def repeats(self) -> bool:
        """True if readings that differ in nothing but set-up and time are predicted equal."""
        return all(effect.cause.repeats for effect in self.accepted)

    @cached_property
    def real(self) -> RealMachine:
        """Its rails and the motions of its carriages, as they really are."""
        geometry = self.machine.nominal_rails
        for effect in self.accepted:
            geometry = effect.cause.geometry(geometry, effect.theta)
        motions = tuple(partial(e.cause.motion, theta=e.theta) for e in self.accepted)
        still = all(effect.cause.stage is not Stage.MOTION for effect in self.accepted)
        return RealMachine(geometry, motions, still)


# Step of complex-step derivatives: its square vanishes against 1, so they are exact.
STEP = 1e-30
# So many readings, of all machines together, are simulated at a time.
AT_ONCE = 1 << 16


def simulate(model: Model, offsets: Numbers, plan: Plan) -> Numbers:
    """Predicted readings, (..., n) [mm], for joint offsets Δρ, (..., 3) [mm] (Table 2, errata).

    The gauge zeros are at the origin of the frame. Leading axes of the parameters of the model's
    causes broadcast with those of the offsets: many machines in one call. Raises PostureError: this
    machine cannot take a posture.
    """
    return _simulate(model, np.asarray(offsets), plan, strict=True)[0]


def synthetic_session(
    model: Model,
    plan: Plan,
    offsets: Floats,
    rng: np.random.Generator,
    gauge: Instrument | None = None,
) -> Readings:
    """Readings of this plan that a known machine would give.

    Args:
        offsets: what each real value exceeds the controller's by, shape (p,) [mm, deg].
        rng: source of noise, of gauge zeros and of a bed's local shape.
        gauge: the machine's own if None; its repeatability is the noise, a resolution of 0 means
            no rounding.

    Raises PostureError: this machine cannot take a posture.
    """
    machine, predict = model.machine, partial(simulate, model, offsets)
    return machine.synthetic(plan, predict, rng, gauge or machine.instrument)


def differentiate(
    model: Model,
    offsets: Floats,
    plan: Plan,
    effects: Sequence[Effect] = (),
    strict: bool = True,
) -> tuple[Floats, Floats]:
    """Readings (..., n) [mm], and their exact derivatives by offsets and parameters, (..., n, q).

    At offsets Δρ (..., 3) [mm]; the parameters are those of `effects`, each of theta (p,), further
    ones than those of the model. In closed form where the offsets alone move the carriages and no
    others are asked for. Else in one simulation of many machines: the point, then a complex step in
    each unknown in turn. Unless it is `strict`, the readings of what is unreachable are NaN.
    """
    if not effects:
        readings, jacobian = _simulate(model, offsets, plan, strict)
        if jacobian is not None:
            return readings, jacobian()
    ends = np.cumsum([offsets.shape[-1], *(effect.theta.size for effect in effects)])
    many = [offsets, *(effect.theta for effect in (*effects, *model.accepted))]
    batch = max(values.ndim for values in many) - 1
    steps = 1j * STEP * np.eye(ends[-1] + 1, ends[-1], k=-1)
    steps = steps.reshape(-1, *[1] * batch, ends[-1])
    some = max(AT_ONCE * offsets.shape[-1] // max(offsets.size * len(plan), 1), 1)
    every = []
    for at in range(0, len(steps), some):
        by_offsets, *by_effect = np.split(steps[at : at + some], ends[:-1], axis=-1)
        stepped = [
            effect.cause.at(effect.theta + step, effect.place)
            for effect, step in zip(effects, by_effect, strict=True)
        ]
        # Real NaN divides in silence, complex NaN does not.
        with np.errstate(invalid="warn" if strict else "ignore"):
            moved = _simulate(model.extended(stepped), offsets + by_offsets, plan, strict)
        every.append(moved[0])
    readings = np.concatenate(every)
    return readings[0].real, np.moveaxis(readings[1:].imag / STEP, 0, -1)


def differentiate_absent(
    model: Model, offsets: Floats, plan: Plan, causes: Sequence[Cause]
) -> tuple[Floats, list[Floats]]:
    """Readings (..., n) [mm], and their derivatives where `causes` are not there.

    At offsets Δρ (..., 3) [mm]: the derivatives by these, (..., n, 3), then those by the p
    parameters of each cause, (..., n, p).
    """
    slopes: dict[Cause, Floats] = {}
    # Apart from those that move the carriages: without these, readings at one posture are equal.
    for moving in (True, False):
        some = [cause for cause in causes if (cause.stage is Stage.MOTION) == moving]
        if some or not moving:
            absent = [cause.absent for cause in some]
            readings, together = differentiate(model, offsets, plan, absent)
            ends = np.cumsum([offsets.shape[-1], *(cause.unknowns for cause in some)])
            by_offsets, *jacobians = np.split(together, ends[:-1], axis=-1)
            slopes |= zip(some, jacobians, strict=True)
    return readings, [by_offsets, *(slopes[cause] for cause in causes)]


def carried_uncertainty(model: Model, offsets: Floats, plan: Plan) -> tuple[Floats, ...]:
    """Change of readings by one standard deviation of each accepted cause's parameters.

    At offsets Δρ (..., 3) [mm]; shape (..., n, p) [mm] for each accepted cause, p its independent
    uncertainties.
    """
    accepted, before = model.accepted, simulate(model, offsets, plan)
    changes = []
    for k, effect in enumerate(accepted):
        spread = effect.spread
        theta = effect.theta + np.expand_dims(spread, tuple(range(1, offsets.ndim)))
        moved = (*accepted[:k], replace(effect, theta=theta), *accepted[k + 1 :])
        readings = simulate(replace(model, accepted=moved), offsets, plan)
        # What has no uncertainty changes nothing, in no column.
        change = np.broadcast_to(readings - before, (len(spread), *before.shape))
        changes.append(np.moveaxis(change, 0, -1))
    return tuple(changes)


def _simulate(
    model: Model, parameters: Numbers, plan: Plan, strict: bool
) -> tuple[Numbers, Callable[[], Floats] | None]:
    """Readings, and what works out their derivative by the parameters, if it is known."""
    machine = model.machine
    if model.repeats:
        plan = plan.steps
    readings, where, jacobian = machine.sensed(model.real, parameters, plan, strict)
    for effect in model.accepted:
        readings = effect.cause.contact(readings, effect, plan, machine, where)
    for effect in model.accepted:
        readings = effect.cause.record(readings, effect, plan, machine)
    as_touched = all(effect.cause.stage is Stage.GEOMETRY for effect in model.accepted)
    return readings, jacobian if as_touched else None
