"""Every command runs in an empty folder of its own, and asks no server by another."""

from pathlib import Path

import pytest

from tests import truth
from tests.cli.program import COMMENT, FIRST


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("MOONRAKER_API_KEY", "http_proxy"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


@pytest.fixture
def to_apply(folder: Path) -> None:
    """A machine file that somebody wrote, and a first measurement."""
    machine = truth.machine_yaml(truth.LARGE, truth.MICRON)
    Path("machine.yaml").write_text(COMMENT + machine, encoding="utf-8")
    truth.write_readings(FIRST, Path("before.csv"))
