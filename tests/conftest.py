"""Programs that the tests start are those of this checkout; random examples are always the same."""

import functools
import gc
import os
import shutil
import signal
import sys
from pathlib import Path
from typing import Any

import pytest
import typer.testing
from hypothesis import settings

ROOT = Path(__file__).parents[1]

# Whatever else is installed in this environment, and wherever a test runs the program.
os.environ["PYTHONPATH"] = str(ROOT)

# Programs that tests start find the package compiled, and the next run these tests.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# One thread for each worker: the tests share two processors.
for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

from orthoglide_cal.cli import app  # noqa: E402
from tests import decisions  # noqa: E402, F401  # after that: it loads numpy

# A shell starts background jobs with this signal ignored, and children inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples in every run, and no time limit on machines that are busy.
settings.register_profile("steady", derandomize=True, database=None, deadline=None, max_examples=60)
settings.load_profile("steady")

# Options are made of the functions' signatures once, not for every command that a test runs.
typer.testing._get_command = functools.cache(typer.testing._get_command)
vars(app)["get_command"] = functools.cache(app.get_command)


def pytest_collection_finish() -> None:
    """Keep what was loaded and collected out of the search for garbage: it stays to the end."""
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> object:
    """Neighbours run in one process, where they share what fixtures made and what was decided."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log)


@pytest.fixture
def beside_the_samples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with copies of the sample data and machines, as in a checkout."""
    for folder in ("sample_data", "configs"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    monkeypatch.chdir(tmp_path)
    return tmp_path
