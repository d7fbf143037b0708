"""Two machines for tests: the prototype and one that differs from it in every length."""

from pathlib import Path

import pytest

from orthoglide_cal.data import default_machine, read_machine

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_data"
PROTOTYPE = default_machine()
LARGE = read_machine(ROOT / "configs" / "orthoglide_large.yaml")

both_machines = pytest.mark.parametrize("machine", [PROTOTYPE, LARGE], ids=["prototype", "large"])
