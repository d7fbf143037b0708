"""A thousand mutants; `python -m tests.fuzz` takes 100,000."""

import contextlib
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.errors import InputError
from orthoglide_cal.session.journal import decode

from .mutate import mutant
from .run import Fuzz, records, signed


def test_no_mutant_breaks_the_program(tmp_path: Path) -> None:
    failures = list(Fuzz(tmp_path, seed=1).run(1000))
    assert not failures, "\n".join(f"{f.number} {f.kind}: {f.what}" for f in failures)


def of_firmwares(folder: Path, count: int) -> str:
    failures = list(Fuzz(folder, seed=1, firmwares=True).run(count))
    return "\n".join(f"{f.number} {f.kind}: {f.what}" for f in failures)


def test_no_mutant_of_a_firmwares_file_breaks_the_program(tmp_path: Path) -> None:
    assert not of_firmwares(tmp_path, 150)


@pytest.mark.slow
def test_no_mutant_of_5000_of_firmwares_files_breaks_the_program(tmp_path: Path) -> None:
    assert not of_firmwares(tmp_path, 5000)


def test_damaged_records_are_read_behind_whole_checksums(tmp_path: Path) -> None:
    """As they stand they are the journal again; most mutants would end at the first checksum."""
    Fuzz(tmp_path, seed=1)
    journal = (tmp_path / "good.journal").read_text(encoding="utf-8")
    assert signed(records(journal)) == journal
    rng = np.random.default_rng(2)
    mutants = [mutant(records(journal), rng) for _ in range(200)]
    wrong = 0
    for text in mutants:
        with contextlib.suppress(InputError):
            decode(signed(text).encode("utf-8", "surrogatepass"), "m.journal")
            wrong += text != records(journal)
    assert wrong > 40


def test_mutants_differ_from_what_they_were_made_of() -> None:
    text = "leg,posture\nx,1.5\n"
    made = [mutant(text, np.random.default_rng(seed)) for seed in range(200)]
    assert sum(each != text for each in made) > 180
    assert len(set(made)) > 100
