"""Full disks: told at once, and nothing that was there is lost."""

import resource
from collections.abc import Callable
from pathlib import Path

from .terminal import run_program


def limit_files(size: int) -> Callable[[], None]:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return limit


def test_a_disk_that_is_full_from_the_beginning(tmp_path: Path) -> None:
    done = run_program(tmp_path, "s.yaml", before=limit_files(100))
    assert done.returncode == 3
    assert "cannot be written" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_is_full_at_the_end(tmp_path: Path) -> None:
    """Not even the session file fits: the journal stays, and --resume ends the session."""
    options = ("--gauge", "simulated", "--seed", "1", "--protocol", "single", "--cycles", "1")
    assert run_program(tmp_path, "s.yaml", *options).returncode == 0
    (tmp_path / "s.yaml").unlink()
    done = run_program(tmp_path, "s.yaml", "--resume", before=limit_files(1000))
    assert done.returncode == 3
    assert not (tmp_path / "s.yaml").exists()
    assert run_program(tmp_path, "s.yaml", "--resume").returncode == 0
    assert (tmp_path / "s.yaml").exists()
