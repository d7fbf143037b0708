"""Adding a cause is adding a file."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import orthoglide_cal
from orthoglide_cal.files.readings import readings_csv
from orthoglide_cal.model.model import synthetic_session
from orthoglide_cal.model.orthoglide import double_posture
from tests.machines import NOMINAL, PROTOTYPE, ROOT

SAG = '''
"""A leg bends with the square of its displacement."""

from orthoglide_cal.model.cause import Cause, Stage
from orthoglide_cal.model.orthoglide import Orthoglide


class LegSag(Cause):
    """One bending per leg, at full displacement."""

    id = "leg_sag"
    title = "a leg sags"
    stage = Stage.CONTACT
    unit = "mm"
    sizes = {Orthoglide: 0.1}
    names = ("x", "y", "z")
    lasting = True
    instrument = "a second gauge on the leg"
    advice = "Stiffen the leg, or measure nearer to the isotropic posture."

    def contact(self, heights, effect, fraction, plan, machine):
        return heights + effect.theta[..., plan.leg] * (plan.displacement / 100.0) ** 2


CAUSES = (LegSag(),)
'''
SIZES = np.array([0.12, -0.17, 0.09])
OFFSETS = np.array([0.4, -0.7, 0.2])


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A folder with the package, compiled as it is, and one more cause in it."""
    source = Path(orthoglide_cal.__file__).parent
    causes = tmp_path / source.name / "causes"
    shutil.copytree(source / "causes", causes, ignore=shutil.ignore_patterns("__pycache__"))
    for other in (path for path in source.iterdir() if path.name != "causes"):
        (causes.parent / other.name).symlink_to(other)
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    (causes / "leg_sag.py").write_text(SAG, encoding="utf-8")
    return tmp_path


def test_one_more_file_is_one_more_answer(package: Path) -> None:
    """Weighed, named, with its parameters, units and advice."""
    plan = double_posture(PROTOTYPE)
    made = synthetic_session(NOMINAL, plan, OFFSETS, np.random.default_rng(5))
    bend = SIZES[plan.leg] * (plan.displacement / 100.0) ** 2
    made = replace(made, value=np.round(made.value + bend, 2))
    (package / "readings.csv").write_text(readings_csv(made), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "orthoglide_cal", "diagnose", "--json", "readings.csv"],
        cwd=package, env={**os.environ, "PYTHONPATH": str(package)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode in (0, 4), done.stderr
    answer = json.loads(done.stdout)
    assert answer["assumed"] == ["leg_sag"]
    assert answer["verdict"] == "named"
    (cause,) = answer["causes"]
    assert cause["id"] == "leg_sag"
    assert cause["remedy"].startswith("Stiffen")
    for estimate, true in zip(cause["parameters"], SIZES, strict=True):
        assert estimate["unit"] == "mm"
        assert abs(estimate["value"] - true) < 4.5 * estimate["std"]
    for found, true in zip(answer["parameters"], OFFSETS, strict=True):
        assert abs(found["found"] - true) < 4.5 * found["std"]
