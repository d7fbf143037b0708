"""Table 2 written again for the tests: eqs. (18) to (24) with the errata, one reading at a time.

The tool is found by Newton's method on the sphere equations, not by eq. (4).
"""

import math

import numpy as np

from orthoglide_cal.model import Contact, Floats, GaugePlan, Machine
from orthoglide_cal.model.kinematics import Geometry
from tests.model.paper_kinematics import tool_near


def nominal_rails(length: float) -> Geometry:
    """Orthogonal rails that meet in the origin, equal legs."""
    return Geometry(np.zeros((3, 3)), np.diag([1.0, 1.0, 1.0]), np.full(3, length))


def tool(length: float, joints: Floats) -> Floats:
    """p with |p − q_i e_i| = L for the three legs, near the origin, shape (3,) [mm]."""
    return tool_near(nominal_rails(length), joints)


def joints(machine: Machine, leg: int, displacement: float) -> Floats:
    """Commanded joints: L + L S_α on the displaced leg, L C_α on the others (eq. 21)."""
    length = machine.leg_length_mm
    angle = math.asin(displacement / length)
    commanded = np.full(3, length * math.cos(angle))
    commanded[leg] = length + length * math.sin(angle)
    return commanded


def gauge_reading(
    machine: Machine,
    offsets: Floats,
    leg: int,
    direction: int,
    displacement: float,
    gauge_at: float = 0.5,
    contact: Contact = Contact.FIXED,
    rails: Geometry | None = None,
) -> float:
    """Height of the touched point of a leg, on nominal rails if none are given [mm].

    From the gauge's fixed place along the leg's axis: μ p_direction (eqs. 20, 23); of the
    carriage or the tool where one of these is touched (Table 1).
    """
    length = machine.leg_length_mm
    rails = nominal_rails(length) if rails is None else rails

    def ends(indicated: Floats) -> tuple[Floats, Floats]:
        moved = indicated + offsets
        return rails.points[leg] + moved[leg] * rails.directions[leg], tool_near(rails, moved)

    start, end = ends(np.full(3, length))
    place = (1.0 - gauge_at) * start[leg] + gauge_at * end[leg]
    start, end = ends(joints(machine, leg, displacement))
    mu = (place - start[leg]) / (end[leg] - start[leg])
    share = {Contact.FIXED: mu, Contact.JOINT: 0.0, Contact.TOOL: 1.0}[contact]
    return float((1.0 - share) * start[direction] + share * end[direction])


def gauge_readings(
    machine: Machine, offsets: Floats, plan: GaugePlan, rails: Geometry | None = None
) -> Floats:
    """`gauge_reading` for each reading of a plan, shape (n,) [mm]."""
    rows = zip(
        plan.leg.tolist(), plan.direction.tolist(), plan.displacement.tolist(),
        plan.gauge_at.tolist(), map(Contact, plan.contact.tolist()), strict=True,
    )  # fmt: skip
    return np.array([gauge_reading(machine, offsets, *row, rails) for row in rows])
