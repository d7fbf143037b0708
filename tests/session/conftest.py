"""A session that others go on from, and a gauge."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from .going_on import SIMULATED
from .terminal import SerialLine, finished


@pytest.fixture(scope="session")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("first")
    gauges = ("--gauge-id", "A", "--gauge-id", "B")
    finished(folder, "a.yaml", "--cycles", "1", *gauges, *SIMULATED)
    return folder / "a.yaml"


@pytest.fixture
def line(tmp_path: Path) -> Iterator[SerialLine]:
    gauge = SerialLine(tmp_path / "ttyUSB0")
    yield gauge
    gauge.close()
