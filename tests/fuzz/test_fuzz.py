"""Hundreds of mutants; `python -m tests.fuzz` takes 100,000."""

import contextlib
from pathlib import Path

import numpy as np
import pytest

from orthoglide_cal.errors import InputError
from orthoglide_cal.session.journal import decode

from .run import Fuzz, mutant, records, signed


@pytest.mark.parametrize(
    ("firmwares", "count"),
    [(False, 100), (True, 20), pytest.param(True, 5000, marks=pytest.mark.slow)],
)
def test_no_mutant_breaks_the_program(tmp_path: Path, firmwares: bool, count: int) -> None:
    failures = list(Fuzz(tmp_path, 1, firmwares).run(count))
    assert not failures, "\n".join(failures)


def test_damaged_records_are_read_behind_whole_checksums(tmp_path: Path) -> None:
    """As they stand they are the journal again; most mutants would end at the first checksum."""
    (journal,) = (text for kind, _, text in Fuzz(tmp_path, 1).kinds if kind == "journal")
    assert signed(records(journal)) == journal
    rng = np.random.default_rng(2)
    wrong = 0
    for _ in range(200):
        text = mutant(records(journal), rng)
        with contextlib.suppress(InputError):
            decode(signed(text).encode("utf-8", "surrogatepass"), "m.journal")
            wrong += text != records(journal)
    assert wrong > 40
