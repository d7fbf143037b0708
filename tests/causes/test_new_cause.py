"""Adding a cause is adding a file."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

import orthoglide_cal
from orthoglide_cal.data import default_machine, machine_text, readings_csv
from orthoglide_cal.effects import Commanded, Effect
from orthoglide_cal.protocols import double_posture, synthetic_session
from tests.machines import ROOT

SAG = '''
"""A leg bends with the square of its displacement."""

import numpy as np

from orthoglide_cal.causes.base import Cause, Step


class LegSag(Cause):
    """One bending per leg, at full displacement."""

    id = "leg_sag"
    title = "a leg sags"
    step = Step.CONTACT
    unit = "mm"
    names = ("x", "y", "z")
    lasting = True
    advice = "Stiffen the leg, or measure nearer to the isotropic posture."

    def contact(self, heights, theta, where, fraction, commanded):
        plan = commanded.plan
        return heights + theta[..., plan.leg] * (plan.displacement / 100.0) ** 2


CAUSE = LegSag()
'''


class Sagging(Effect):
    """The same in the forward model, written without the file."""

    def contact(
        self, heights: np.ndarray, fraction: np.ndarray, commanded: Commanded
    ) -> np.ndarray:
        sizes = np.array([0.12, -0.17, 0.09])
        plan = commanded.plan
        return heights + sizes[plan.leg] * (plan.displacement / 100.0) ** 2


def test_one_more_file_is_one_more_answer(tmp_path: Path) -> None:
    """In a copy of the package: weighed, named, with its parameters, units and advice."""
    package = Path(orthoglide_cal.__file__).parent
    shutil.copytree(package, tmp_path / package.name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    (tmp_path / package.name / "causes" / "leg_sag.py").write_text(SAG, encoding="utf-8")
    machine = default_machine()
    text = machine_text(machine).replace("tolerances: {", "tolerances: {leg_sag: 0.1, ")
    assert "leg_sag" in text
    (tmp_path / "machine.yaml").write_text(text, encoding="utf-8")
    plan, rng = double_posture(machine), np.random.default_rng(5)
    offsets = np.array([0.4, -0.7, 0.2])
    made = synthetic_session(machine, plan, offsets, rng, [Sagging()])
    (tmp_path / "readings.csv").write_text(readings_csv(made), encoding="utf-8")
    command = [sys.executable, "-m", package.name, "diagnose", "--json"]
    done = subprocess.run(
        [*command, "--machine", "machine.yaml", "readings.csv"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["verdict"] == "named"
    (cause,) = answer["causes"]
    assert cause["id"] == "leg_sag"
    assert cause["advice"].startswith("Stiffen")
    for name, true in (("x", 0.12), ("y", -0.17), ("z", 0.09)):
        estimate = cause["parameters"][name]
        assert estimate["unit"] == "mm"
        assert abs(estimate["value"] - true) < 4.5 * estimate["std"]
    for axis, true in zip("xyz", offsets, strict=True):
        assert abs(answer["offsets_mm"][axis] - true) < 4.5 * answer["std_mm"][axis]
