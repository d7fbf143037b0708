"""A linear delta for tests, and what the independent truth knows, in the program's form."""

from dataclasses import replace

import numpy as np
import yaml

from orthoglide_cal.model.linear_delta import Endstops, LinearDelta, Probe, ProbePlan
from orthoglide_cal.model.measured import Readings, Source
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats, Plan
from tests.machines import ROOT
from tests.truth.delta import Delta, Layout, Truth, places_of
from tests.truth.plan import frozen

CONFIG = ROOT / "configs" / "linear_delta.yaml"
UNEVEN = Delta("uneven", (300.0, 301.5, 299.25), 150.0, (209.0, 331.5, 90.0), (380.0, 381.0, 379.5))


def printer(machine: Delta, tolerances: dict[str, float] | None = None) -> LinearDelta:
    return LinearDelta(
        name=machine.name,
        arm_length_mm=machine.arms,
        delta_radius_mm=machine.radius,
        tower_angles_deg=machine.angles,
        endstops_mm=Endstops(*machine.endstops),
        bed_radius_mm=machine.bed,
        probe=Probe(
            resolution_mm=machine.resolution,
            repeatability_mm=machine.noise,
            calliper_mm=machine.calliper,
            texture_mm=0.0,
        ),
        tolerances=tolerances or {},
    )


PRINTER = printer(UNEVEN, yaml.safe_load(CONFIG.read_text(encoding="utf-8"))["tolerances"])
NOMINAL_PRINTER = Model(PRINTER)


def touched(place: Floats, surface: Floats | float = 0.0, hours: Floats | float = 0.0) -> ProbePlan:
    """Touches of surfaces at places (n, 3) [mm], one after the other."""
    n = len(place)
    return ProbePlan(
        order=np.arange(n), hours=np.broadcast_to(hours, n), place=place, other=place,
        surface=np.broadcast_to(surface, n), distance=np.zeros(n, dtype=bool), precision=np.ones(n),
    )  # fmt: skip


def printed(first: Floats, second: Floats, weight: float = 1.0) -> ProbePlan:
    """Distances between places (n, 3) of a printed object [mm]."""
    every = np.ones(len(first))
    return replace(touched(first), other=second, distance=every > 0, precision=weight * every)


def both(touches: ProbePlan, distances: ProbePlan) -> ProbePlan:
    return Plan.joined(touches, replace(distances, order=distances.order + len(touches)))


def standard_plan(machine: Delta = UNEVEN) -> ProbePlan:
    """Every kind of reading: 25 touches on each of three heights within an hour, six distances."""
    at = np.tile(places_of(Layout(places=25), machine.bed), (3, 1))
    blocks = np.repeat([0.0, 20.0, 50.0], 25)
    rng = np.random.default_rng(8)
    place = np.column_stack((at, blocks + rng.normal(0.0, 0.1, len(at))))
    turn = np.radians(60.0 * np.arange(6))
    ring = 0.6 * machine.bed * np.stack((np.cos(turn), np.sin(turn), 0.0 * turn), axis=1)
    touches = touched(place, blocks, np.linspace(0.0, 1.0, len(at)))
    return both(touches, printed(ring, np.roll(ring, 2, axis=0), 0.4))


def readings_of_touches(plan: ProbePlan, value: Floats) -> Readings:
    """Values (n,) [mm] as a file would give them."""
    source, line = Source("made.csv", "0" * 64), np.arange(2, len(plan) + 2)
    return Readings(plan, value, line, True, source)


def true_values(machine: Delta, truth: Truth) -> Floats:
    """What of a truth a calibration determines, (6,) [mm, deg], where nothing else is wrong.

    The truth counts endstops as heights of the carriages, the program as those of a nozzle in the
    middle, from which the carriages follow by radius and arms.
    """
    arms = np.array(machine.arms)
    raised = np.sqrt((arms + truth.arms) ** 2 - (machine.radius + truth.radius) ** 2) - np.sqrt(
        arms**2 - machine.radius**2
    )
    return np.array([*(truth.endstops - raised), truth.radius, *truth.angles[:2]])


def truth_with(
    machine: Delta,
    values: Floats,
    leans: Floats | None = None,
    radii: Floats | None = None,
    arms: Floats | None = None,
    scales: Floats | None = None,
) -> Truth:
    """The truth of what the program's parameters mean, by hand.

    Args:
        values: of what is calibrated, (6,) [mm, deg].
        leans: (3 towers, out and side) [mrad], about the height at which a carriage stands with
            the tool in the middle of the bed.
        radii, arms: excess of each tower and arm, (3,) [mm].
        scales: of the travel from the mean of these heights, (3,) [1e-3].
    """
    leans = np.zeros((3, 2)) if leans is None else 1e-3 * leans
    radii, arms, scales = (np.zeros(3) if v is None else v for v in (radii, arms, scales))
    angle = np.radians(machine.angles)
    out = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    side = np.stack((-np.sin(angle), np.cos(angle)), axis=1)
    lean = leans[:, :1] * out + leans[:, 1:] * side
    upright = 1.0 / np.sqrt(1.0 + (lean**2).sum(axis=1))
    # Where a carriage stands with the tool in the middle of the bed; there the rail is as it was.
    middle = np.sqrt(np.array(machine.arms) ** 2 - machine.radius**2)
    turned = np.radians(machine.angles + np.array([values[4], values[5], 0.0]))
    moved = (machine.radius + values[3]) * np.stack((np.cos(turned), np.sin(turned)), axis=1)
    foot = moved + radii[:, None] * out - middle[:, None] * lean
    away, angles = np.hypot(*foot.T), np.arctan2(foot[:, 1], foot[:, 0])
    new_out = foot / away[:, None]
    new_side = np.stack((-new_out[:, 1], new_out[:, 0]), axis=1)
    around = np.stack(((lean * new_out).sum(axis=1), (lean * new_side).sum(axis=1)), axis=1)
    real = np.array(machine.arms) + arms
    shared = np.sqrt(real**2 - (machine.radius + values[3]) ** 2) - middle
    # A rail that leans is longer up to the same height; travel counts from the endstop.
    travel = np.array(machine.endstops) + middle - middle.mean()
    endstops = values[:3] + shared + middle * (1.0 / upright - 1.0)
    return Truth(
        endstops=frozen(endstops + 1e-3 * scales * travel),
        angles=frozen(np.degrees((angles - angle + np.pi) % (2.0 * np.pi) - np.pi)),
        radii=frozen(away - machine.radius), leans=frozen(1e3 * around), arms=frozen(arms),
        scales=frozen(scales),
    )  # fmt: skip
