"""Distance of the tool from where the controller believes it to be, and its compensation.

The controller commands ρ = inverse kinematics of p on the nominal machine; the tool goes to p' =
direct kinematics of the real one at ρ + Δρ. The error is |p' − p|; after the offsets are entered,
with k·u of the tool position that their uncertainty leaves: an upper bound.
"""

import functools

import numpy as np
from pydantic import Field
from pydantic.json_schema import SkipJsonSchema

from orthoglide_cal.errors import PostureError, UsageError
from orthoglide_cal.model.kinematics import Command, Points
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.plan import Floats, read_only
from orthoglide_cal.schema import Schema

SAMPLES = 17  # along each edge of the cube


class Workspace(Schema):
    """Largest error of the tool position over the cube that the joint limits allow."""

    before_mm: float
    after_mm: float
    worst_before_mm: tuple[float, ...] = Field(description="tool position where it is largest")
    worst_after_mm: tuple[float, ...]
    limit_mm: float | None = None
    left_mm: float = Field(description="what the causes alone leave after entering")
    cube_mm: tuple[float, float]
    # Before and after, in the lowest, the middle and the highest slice, [slice, y, x], (3, n, n).
    maps: SkipJsonSchema[tuple[Floats, Floats] | None] = Field(None, exclude=True, repr=False)


@functools.lru_cache(maxsize=4)
def _grid(model: Model, points: int) -> tuple[Floats, Floats]:
    """A grid of the cube, n points along each edge, x fastest, and the joints that the controller
    has for them, both (n³, 3) [mm]."""
    axis = np.linspace(*model.machine.cube, points)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    return read_only(grid), read_only(model.machine.nominal_rails.joints_for(grid))


def _standing(model: Model, indicated: Floats, offsets: Floats) -> Floats:
    """Joints of carriages that have not moved yet, sent to `indicated`, both (n, 3) [mm]."""
    nothing = np.zeros(indicated.shape)
    command = Command(indicated, model.machine.home_mm, nothing[:, 0], nothing, nothing)
    return np.asarray(model.real.joints(command, offsets))


# A plan asks for it once for each of its sessions.
@functools.lru_cache(maxsize=4)
def _corrected(model: Model) -> tuple[Floats, Floats]:
    """Error of the tool with all offsets entered, (n,) [mm], and JᵀJ of the tool, (n, 9)."""
    points, indicated = _grid(model, SAMPLES)
    reached = Points.of(model.real.geometry, _standing(model, indicated, np.zeros(3)), strict=True)
    jacobian = Points.batch_first(reached.tool_derivative, 2)
    square = jacobian.swapaxes(-1, -2) @ jacobian
    if not np.isfinite(square).all():
        fault = "The three legs lie in one plane: the machine is singular at a posture."
        raise PostureError(fault, "Choose a smaller workspace.")
    left = np.linalg.norm(reached.tool.T - points, axis=-1)
    return left, square.reshape(-1, 9)


def error_after(model: Model, covariance: Floats, k: float) -> tuple[Floats, Floats]:
    """Error of the tool once the offsets are entered, over the cube, each (n,) [mm]: by the
    causes alone, and with k·u; arguments and errors as of `workspace_error`."""
    left, square = _corrected(model)
    return left, left + k * np.sqrt(square @ covariance.reshape(-1))


def workspace_error(model: Model, offsets: Floats, covariance: Floats, k: float) -> Workspace:
    """Tool-position error of a real machine before and after the offsets are entered.

    `offsets` are Δρ that the controller does not know yet, shape (3,) [mm]; their `covariance`,
    shape (3, 3) [mm²], remains, expanded by k. Raises PostureError: a corner of the cube that the
    machine cannot reach; UsageError: it has no cube.
    """
    points, indicated = _grid(model, SAMPLES)
    tool = model.real.geometry.tool_for(_standing(model, indicated, offsets))
    before = np.sqrt(np.square(tool - points) @ np.ones(3))
    left, after = error_after(model, covariance, k)
    levels = [0, SAMPLES // 2, SAMPLES - 1]
    maps = (read_only(e.reshape((SAMPLES,) * 3)[levels]) for e in (before, after))
    return Workspace(
        before_mm=float(before.max()),
        after_mm=float(after.max()),
        worst_before_mm=tuple(points[np.argmax(before)].tolist()),
        worst_after_mm=tuple(points[np.argmax(after)].tolist()),
        left_mm=float(left.max()),
        cube_mm=model.machine.cube,
        maps=tuple(maps),
    )


def compensation(model: Model, points: int = 7) -> Floats:
    """Joint corrections over the workspace, for causes accepted for a machine; shape (n, 6) [mm].

    At each tool position p of a grid, with `points` along each edge: ρ* − ρ_nominal(p), where ρ*
    are the indicated joints that really put the tool at p once the offsets are entered.

    Raises UsageError: no accepted cause can be compensated; PostureError: a leg is too short.
    """
    chosen = tuple(effect for effect in model.remaining() if effect.cause.compensable)
    if not chosen:
        fault = "The machine file holds no accepted cause that a table could compensate."
        raise UsageError(fault, "Accept one first, with diagnose and its option --accept.")
    grid, nominal = _grid(model, points)
    known = Model(model.machine, chosen)
    # Causes of the motion are nearly the identity, so that a fixed-point iteration converges.
    needed = wanted = known.real.geometry.joints_for(grid)
    for _ in range(50):
        missing = wanted - _standing(known, needed, np.zeros(3))
        needed = needed + missing
        if float(np.abs(missing).max()) < 1e-9:
            break
    return read_only(np.hstack((grid, needed - nominal)))
