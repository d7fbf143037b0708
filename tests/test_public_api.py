"""What each room exports: changing it is a decision, not an accident."""

import importlib

import pytest

from tests.machines import ROOT

EXPORTS = {
    "kinematics": (
        "WORKING_MODES", "Geometry", "direct", "displaced_jacobian", "inverse",
        "inverse_jacobian", "isotropic_jacobian", "jacobian", "leg_angle", "rail_position",
        "tool_derivative", "trilaterate",
    ),
    "protocols": (
        "NAMES", "SINGLE", "SIX", "TWELVE", "cell_contrasts", "double_posture", "ideal_plan",
        "other_axes", "reduction", "single_posture", "synthetic_session", "without_zeros",
        "written_down", "zero_free",
    ),
    "estimation": (
        "METHODS", "Batch", "Fit", "Problem", "Solution", "TableRow", "fit_offsets", "solve",
        "solve_many", "usable_methods",
    ),
    "causes": (
        "CAUSES", "MACHINE_WIDE", "Acting", "Cause", "PatternCause", "RelabelCause", "Step",
        "Where", "machine_effects",
    ),
    "cli": ("main",),
}  # fmt: skip
ROOMS = sorted(path.parent.name for path in (ROOT / "orthoglide_cal").glob("*/__init__.py"))


@pytest.mark.parametrize("room", EXPORTS)
def test_exports_are_pinned(room: str) -> None:
    assert tuple(importlib.import_module(f"orthoglide_cal.{room}").__all__) == EXPORTS[room]


@pytest.mark.parametrize("room", ROOMS)
def test_everything_exported_exists_and_is_documented(room: str) -> None:
    module = importlib.import_module(f"orthoglide_cal.{room}")
    names = getattr(module, "__all__", [])
    assert len(set(names)) == len(names)
    for name in names:
        assert hasattr(module, name)
        value = getattr(module, name)
        if callable(value):
            assert value.__doc__, f"{room}.{name}"


def test_the_version_is_a_version() -> None:
    import orthoglide_cal

    assert orthoglide_cal.__version__.count(".") == 2
