"""What no session can go on from, and what is asked before one does."""

from pathlib import Path

import pytest

from tests.machines import ROOT, SAMPLES
from tests.printer_files import OFF, printer_cfg
from tests.truth.delta import V400

from .going_on import choice, is_step
from .terminal import refused

LARGE = str(ROOT / "configs" / "orthoglide_large.yaml")
TOGETHER = "--then and {} do not go together"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--protocol", "single"), TOGETHER.format("--protocol or --design")),
        (("--design", "best"), TOGETHER.format("--protocol or --design")),
        (("--cycles", "2"), TOGETHER.format("--cycles")),
        (("--order", "paper"), TOGETHER.format("--order")),
        (("--until", "0.1"), TOGETHER.format("--until")),
        (("--resume",), TOGETHER.format("--resume")),
        (("--choice", "999"), "There is no recommendation 999"),
        (("--seed", "8"), "was not measured on this simulated machine"),
        (("--offsets-active", "1000", "0", "0"), "These are not three joint offsets"),
        (("--machine", LARGE), "was measured on another machine than that of --machine"),
        # Other files to go on with; the last one counts.
        (("--then", f"{SAMPLES}/experiment1.csv"), "holds differences; new readings cannot be"),
        (("--then", f"{SAMPLES}/experiment2.csv"), "Give the file of the raw readings"),
        (("--then", f"{SAMPLES}/single_posture_session.csv"), "readings of both kinds cannot be"),
        (("--then", "none.csv"), "There is no such file"),
        (("--then", "printer.cfg"), "No protocol guides through measuring a linear delta"),
        (("--then", "-"), "standard input is the keyboard"),
    ],
)
def test_what_cannot_be_gone_on_with_is_refused(
    first: Path, tmp_path: Path, options: tuple[str, ...], said: str
) -> None:
    printer = tmp_path / "printer.cfg"
    printer.write_text(printer_cfg(V400, OFF), encoding="utf-8")
    code = 3 if "none.csv" in options else 2
    assert said in refused(code, tmp_path, "n.yaml", "--then", str(first), *options, "--yes")
    assert list(tmp_path.iterdir()) == [printer]


def test_the_first_file_is_never_the_new_one(first: Path) -> None:
    before = first.read_bytes()
    for name in ("a.yaml", "a"):
        assert "never changed" in refused(2, first.parent, name, "--then", "a.yaml", "--yes")
    assert first.read_bytes() == before


def test_stands_that_were_pushed_are_not_gone_on_with(first: Path, tmp_path: Path) -> None:
    """New offsets act once the machine was homed."""
    given = (*choice(first, is_step), "--offsets-active", "0.5", "0", "0")
    assert "changed since the last reading" in refused(2, tmp_path, "n.yaml", *given)
    assert not list(tmp_path.iterdir())
