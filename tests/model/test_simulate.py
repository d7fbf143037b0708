"""The forward model: rails in any position, derivatives, what is out of reach, what gauges show.

Tool-position error and compensation, against the kinematics of the independent truth.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import PostureError, UsageError
from orthoglide_cal.estimation.solution import zero_free
from orthoglide_cal.model.kinematics import Points, trilaterate
from orthoglide_cal.model.machine import Machine
from orthoglide_cal.model.model import STEP, Model, differentiate, simulate
from orthoglide_cal.model.orthoglide import double_posture, single_posture
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import Contact, GaugePlan, Posture
from orthoglide_cal.model.workspace import SAMPLES, compensation, workspace_error
from tests.machines import NOMINAL, PROTOTYPE, both_machines, extended
from tests.truth.forward import tool_from_carriages

OFFSETS = np.array([1.7, -2.9, 0.8])
POINT = np.array([31.0, -47.0, 12.0])
L = PROTOTYPE.leg_length_mm


def bent(machine: Machine) -> Model:
    """Rails that neither meet nor are orthogonal, unequal legs: degrees and millimetres."""
    known = extended(axis_gap=(8.0, -6.0, 5.0), axis_squareness=(60.0, -80.0, 40.0))
    return replace(known, machine=machine).extended(extended(leg_length=(3.0, -2.0, 4.0)).accepted)


def mixed(machine: Machine) -> GaugePlan:
    """Gauges at a different place for every reading, a third of them at the ends of the legs."""
    plan = double_posture(machine, cycles=2)
    n, rng = len(plan), np.random.default_rng(11)
    contact = rng.choice([Contact.FIXED] * 4 + [Contact.JOINT, Contact.TOOL], n)
    return replace(plan, gauge_at=rng.uniform(0.1, 0.9, n), contact=contact)


def stepped_within(plan: GaugePlan) -> GaugePlan:
    """The closing readings of each leg are taken after a step was entered, stands untouched."""
    closing = np.array([np.flatnonzero(plan.setup == k)[-1] for k in range(plan.setups)])
    entered = np.zeros((len(plan), 3))
    entered[closing] = 0.5, 0.0, -0.2
    return replace(plan, entered=entered)


@both_machines
@pytest.mark.parametrize("made", [Model, bent])
@pytest.mark.parametrize("gauges", [0.25, 0.5, "mixed", "ends", "stepped"])
def test_the_closed_form_of_the_jacobian(
    machine: Machine, gauges: float | str, made: Callable[[Machine], Model]
) -> None:
    """On rails of every sort, with gauges anywhere."""
    plans = {
        "mixed": mixed(machine),
        "ends": single_posture(machine, 2),
        "stepped": stepped_within(double_posture(machine, 1)),
    }
    plan = plans.get(gauges) or double_posture(machine, cycles=2, gauge_at=gauges)
    model = made(machine)
    assert model.real.still
    readings, slope = differentiate(model, OFFSETS, plan)
    assert np.array_equal(readings, simulate(model, OFFSETS, plan))
    # By complex steps: exact, and they know no closed form.
    exact = simulate(model, OFFSETS + 1j * STEP * np.eye(3), plan).imag.T / STEP
    assert np.abs(slope - exact).max() < 1e-12
    # What bends the rails is in it: readings change by more per millimetre than is resolved here.
    nominal = differentiate(Model(machine), OFFSETS, plan)[1]
    assert (np.abs(slope - nominal).max() > 1e-4) == (made is not Model)


def test_an_unreachable_session_is_an_error_or_nan() -> None:
    plan = double_posture(PROTOTYPE, cycles=1)
    offsets = np.array([[0.1, 0.2, 0.3], [300.0, 300.0, 300.0]])
    with pytest.raises(PostureError, match="Leg x displaced by 0 mm: The legs do not reach"):
        simulate(NOMINAL, offsets, plan)
    with pytest.raises(PostureError, match="Leg y displaced by 60 mm: The legs do not reach"):
        simulate(NOMINAL, np.array([30.0, 85.0, 30.0]), plan)
    creeping = NOMINAL.extended([CAUSES["thermal_drift"].at(np.array([0.1, -0.2, 0.1]))])
    for model in (NOMINAL, creeping):
        readings, slope = differentiate(model, offsets, plan, strict=False)
        assert np.isfinite(readings[0]).all()
        assert np.isfinite(slope[0]).all()
        assert np.isnan(readings[1]).any()
        with pytest.raises(PostureError, match="Leg x displaced by 0 mm"):
            differentiate(model, offsets, plan)


def test_legs_too_short_where_the_gauges_are_set_up_are_named() -> None:
    low = double_posture(PROTOTYPE, cycles=1, closing=False, postures=(Posture.MIN,))
    with pytest.raises(PostureError, match="Isotropic posture: The legs do not reach"):
        simulate(extended(leg_length=(250.0 - L,) * 3), OFFSETS, low)


def test_written_down_readings_have_the_gauges_noise_zeros_and_steps() -> None:
    """Chance of failure about 1e-6 (five standard deviations of a variance)."""
    plan, rng = double_posture(PROTOTYPE), np.random.default_rng(3)
    signal = simulate(NOMINAL, OFFSETS, plan)
    made = (PROTOTYPE.synthetic(plan, lambda _: signal, rng, PROTOTYPE.gauge) for _ in range(1000))
    values = np.array([each.value for each in made])
    steps = values / PROTOTYPE.gauge.resolution_mm
    assert np.abs(steps - np.rint(steps)).max() < 1e-9
    spread = (values - signal) @ zero_free(plan).T
    expected = PROTOTYPE.gauge.noise_mm
    assert spread.std() == pytest.approx(expected, rel=5.0 / np.sqrt(2.0 * spread.size) + 0.01)
    zeros = (values - signal)[:, 0]
    assert zeros.min() < -0.9
    assert zeros.max() > 0.9


# --- rails in any position ---------------------------------------------------------------------


@both_machines
def test_bent_rails_keep_the_legs_as_long_as_they_are(machine: Machine) -> None:
    rails = bent(machine).real.geometry
    tool = np.random.default_rng(3).uniform(*machine.joint_limits_mm, (400, 3))
    joints = rails.joints_for(tool)
    carriages = rails.points + joints[..., None] * rails.directions
    lengths = np.linalg.norm(tool[:, None, :] - carriages, axis=-1)
    assert np.abs(lengths - rails.lengths).max() < 1e-10
    # The carriages stand ahead of the tool, as the prototype's do.
    assert np.all(joints > ((tool[:, None] - rails.points) * rails.directions).sum(axis=-1))
    # Direct undoes inverse, and inverse direct.
    assert np.abs(rails.tool_for(joints) - tool).max() < 1e-9
    assert np.abs(rails.joints_for(rails.tool_for(joints + 0.37)) - joints - 0.37).max() < 1e-9


def test_legs_that_do_not_reach_have_no_tool() -> None:
    """Nor carriages on a line: of three the middle one adds nothing."""
    apart, in_line = np.full(3, 600.0), np.outer([250.0, 300.0, 400.0], [1.0, 2.0, 2.0]) / 3.0
    assert np.isnan(trilaterate(np.diag(apart), np.full(3, L))).all()
    assert np.isnan(trilaterate(in_line, np.full(3, L))).all()
    rails = NOMINAL.machine.nominal_rails
    with pytest.raises(PostureError, match="do not reach each other") as caught:
        rails.tool_for(apart)
    assert "limits" in caught.value.remedy
    assert np.isnan(rails.tool_for(apart, strict=False)).all()


@pytest.mark.parametrize(
    ("point", "leg"),
    [((10.0, 250.0, -200.0), "x"), ((250.0, 10.0, -200.0), "y"), ((-200.0, 250.0, 10.0), "z")],
)
def test_a_leg_too_short_is_named(point: tuple[float, float, float], leg: str) -> None:
    at = r"\({:.3f}, {:.3f}, {:.3f}\)".format(*point)
    with pytest.raises(PostureError, match=f"Leg {leg} is too short .* {at}") as caught:
        NOMINAL.machine.nominal_rails.joints_for(np.array([POINT, point]))
    assert "workspace" in caught.value.remedy
    longer = PROTOTYPE.changed(leg_length_mm=400.0)
    assert np.isfinite(longer.nominal_rails.joints_for(np.array([POINT, point]))).all()


def test_legs_in_one_plane_are_singular() -> None:
    """All three legs perpendicular to (1, 1, 1): p = (s, s, s), q = 3 s on each rail.

    Also where rounding leaves some volume, on rails turned by any angle, and in a batch.
    """
    turn = np.linalg.qr(np.random.default_rng(4).normal(0.0, 1.0, (3, 3)))[0]
    turned = replace(PROTOTYPE.nominal_rails, directions=turn)
    for rails in (PROTOTYPE.nominal_rails, turned):
        tool = np.array([[20.0, 30.0, 50.0], [50.0, 50.0, 50.0]]) @ rails.directions
        points = Points.of(rails, np.full((2, 3), 150.0))._replace(tool=tool.T)
        fine = np.isfinite(points.tool_derivative)
        assert fine[..., 0].all()
        assert not fine[..., 1].any()


@pytest.mark.parametrize("moved", [L, -L, 400.0])
def test_a_leg_displaced_by_its_length_is_named(moved: float) -> None:
    with pytest.raises(PostureError, match=f"Leg z cannot be displaced by {moved:g} mm"):
        NOMINAL.machine.joints_at(np.array([0, 2]), np.array([60.0, moved]))


NONE = np.zeros(3)
COVARIANCE = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, -2.0], [0.0, -2.0, 5.0]]) * 1e-4
GAPS, SCALES, LONGER = (0.3, -0.2, 0.25), (1.0, -2.0, 0.5), (0.05, -0.02, 0.03)
SLICES = [0, SAMPLES // 2, SAMPLES - 1]


def cube(axis: Floats) -> Floats:
    """All points with such coordinates, x changing fastest and z least, shape (n, 3) [mm]."""
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    return np.stack((x, y, z), axis=-1).reshape(-1, 3)


def inverse(tool: Floats, length: float = L) -> Floats:
    """ρ_i = p_i + √(L² − p_j² − p_k²) (eq. 3; errata, rows y and z), shape (n, 3) [mm]."""
    others = (tool**2).sum(axis=-1, keepdims=True) - tool**2
    return np.asarray(tool + np.sqrt(length**2 - others))


def reached(joints: Floats, gaps: Floats = NONE, longer: Floats = NONE) -> Floats:
    """The truth's tool, rails apart by half a gap each, other legs: (n, 3) → (n, 3) [mm]."""
    xy, yz, zx = 0.5 * np.array(gaps)
    points = np.array([[0.0, -zx, xy], [yz, 0.0, -xy], [-yz, zx, 0.0]])
    carriages = points[:, :, None] + np.eye(3)[:, :, None] * joints.T[:, None]
    legs = L + np.reshape(longer, (3, 1))
    return tool_from_carriages(carriages, legs, joints.T - L, steps=12).T


def test_entering_offsets_leaves_the_errors_of_accepted_causes() -> None:
    """Rails apart, longer legs, wrong scales, over the whole cube: with the offsets, without."""
    model = extended(axis_gap=GAPS, encoder_scale=SCALES, leg_length=LONGER)
    found = workspace_error(model, OFFSETS, np.zeros((3, 3)), 2.0)
    assert found.cube_mm == NOMINAL.machine.cube
    points = cube(np.linspace(*found.cube_mm, SAMPLES))
    joints = L + (1.0 + 1e-3 * np.array(SCALES)) * (inverse(points) - L)
    for offsets, slices, largest in (
        (OFFSETS, found.maps[0], found.before_mm),
        (NONE, found.maps[1], found.after_mm),
    ):
        error = np.linalg.norm(reached(joints + offsets, GAPS, LONGER) - points, axis=1)
        assert slices == pytest.approx(error.reshape((SAMPLES,) * 3)[SLICES], abs=1e-9)
        assert largest == pytest.approx(error.max(), abs=1e-9)
    assert found.left_mm == found.after_mm


def test_after_is_what_the_uncertainty_leaves() -> None:
    """k √(tr J C Jᵀ), with J from finite differences, which err by 1e-8 of it."""
    found = workspace_error(NOMINAL, OFFSETS, COVARIANCE, 3.0)
    joints = inverse(cube(np.linspace(*found.cube_mm, SAMPLES)))
    slope = np.stack(
        [(reached(joints + move) - reached(joints - move)) / 2e-3 for move in 1e-3 * np.eye(3)],
        axis=-1,
    )
    after = 3.0 * np.sqrt(np.einsum("nij,jk,nik->n", slope, COVARIANCE, slope))
    assert found.maps[1] == pytest.approx(after.reshape((SAMPLES,) * 3)[SLICES], rel=1e-6)
    assert found.after_mm == pytest.approx(after.max(), rel=1e-6)


def test_carriages_that_stand_have_no_past() -> None:
    """Lost motion and drift are of a session: nothing of them in a place of the workspace."""
    moving = extended(backlash=(0.3, 0.2, 0.4), thermal_drift=(0.5, -0.3, 0.4))
    found, plain = (workspace_error(m, OFFSETS, COVARIANCE, 2.0).maps for m in (moving, NOMINAL))
    assert np.array_equal(found, plain)
    assert not any(slices.flags.writeable for slices in found)


def displacements(machine: Machine, low: float, high: float) -> Floats:
    """Of the carriages from their isotropic places, all over the cube [low, high]³."""
    axis = np.append(np.linspace(low, high, 21), 0.0)
    return inverse(cube(axis), machine.leg_length_mm) - machine.leg_length_mm


@both_machines
@pytest.mark.parametrize("limits", [None, (-40.0, 60.0), (-100.0, 12.0)])
def test_the_cube_stays_within_the_joint_limits(
    machine: Machine, limits: tuple[float, float] | None
) -> None:
    """And reaches them: each limit is met somewhere in it."""
    machine = machine.changed(
        joint_limits_mm=limits or machine.joint_limits_mm, workspace_mm=1000.0
    )
    moved = displacements(machine, *machine.cube)
    assert moved.min() == pytest.approx(machine.joint_limits_mm[0], abs=1e-6)
    assert moved.max() == pytest.approx(machine.joint_limits_mm[1], abs=1e-6)


def test_the_cube_is_no_larger_than_the_workspace_and_stays_where_it_was() -> None:
    whole = PROTOTYPE.changed(workspace_mm=1000.0).cube
    small = PROTOTYPE.changed(workspace_mm=50.0).cube
    assert small[1] - small[0] == pytest.approx(50.0)
    assert sum(small) == pytest.approx(sum(whole))
    wide = PROTOTYPE.changed(joint_limits_mm=(-300.0, 300.0), workspace_mm=1000.0)
    low, high = wide.cube
    assert (low, high) == (-L / 2.0, L / 2.0)
    assert np.isfinite(displacements(wide, low, high)).all()


def test_compensated_joints_put_the_tool_right() -> None:
    """Each row, on a machine built here from the causes' definitions: rails apart, other legs,
    other scales."""
    model = extended(axis_gap=GAPS, encoder_scale=SCALES, leg_length=LONGER, backlash=(0.1,) * 3)
    places, corrections = np.split(compensation(model, points=3), 2, axis=1)
    low, high = NOMINAL.machine.cube
    points = cube(np.array([low, (low + high) / 2.0, high]))
    assert places == pytest.approx(points, abs=1e-12)
    indicated = inverse(points) + corrections
    joints = L + (1.0 + 1e-3 * np.array(SCALES)) * (indicated - L)
    assert reached(joints, GAPS, LONGER) == pytest.approx(points, abs=1e-7)
    assert np.abs(corrections).max() > 0.05


def test_nothing_to_compensate_is_said() -> None:
    for model in (NOMINAL, extended(backlash=(0.1, 0.1, 0.1)), extended(bar_skew=(0.1,) * 6)):
        with pytest.raises(UsageError, match="no accepted cause"):
            compensation(model, 7)
    assert len(compensation(extended(axis_gap=(0.1, 0.1, 0.1)), 2)) == 8
