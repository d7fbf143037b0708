"""Hundreds of mutants; `python -m tests.fuzz` takes 100,000."""

from pathlib import Path

import pytest

from .run import Fuzz


@pytest.mark.parametrize(
    ("firmwares", "count"),
    [(False, 100), (True, 20), pytest.param(True, 5000, marks=pytest.mark.slow)],
)
def test_no_mutant_breaks_the_program(tmp_path: Path, firmwares: bool, count: int) -> None:
    failures = list(Fuzz(tmp_path, 1, firmwares).run(count))
    assert not failures, "\n".join(failures)
