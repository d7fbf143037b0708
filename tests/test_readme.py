"""What the README shows is what the program prints; its examples are run with the guide's."""

import re

import pytest

from tests.cli.program import run
from tests.machines import ROOT
from tests.markdown import blocks
from tests.pictures import pictures

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
DRAWING, ANSWER, ROOMS = blocks(TEXT, "text")
GUIDE = ROOT / "orthoglide_cal" / "guide"

pytestmark = pytest.mark.usefixtures("beside_the_samples")


def test_the_shown_answer_is_the_programs() -> None:
    assert ANSWER in run("solve", "sample_data/double_posture_session.csv").stdout


def test_the_pictures_show_what_the_program_says() -> None:
    """If the words were changed on purpose: `python -m tests.pictures` makes the pictures again."""
    for name, content in pictures().items():
        assert f"](sample_data/{name})" in TEXT
        assert (ROOT / "sample_data" / name).read_text(encoding="utf-8") == content, name


def test_the_drawing_is_that_of_the_guide() -> None:
    assert DRAWING in blocks((GUIDE / "postures.md").read_text(encoding="utf-8"), "text")


def test_a_newcomer_reads_it_to_its_end() -> None:
    assert len(TEXT.splitlines()) <= 150


def test_every_folder_of_the_package_is_named() -> None:
    rooms = {path.name for path in (ROOT / "orthoglide_cal").iterdir() if path.is_dir()}
    for room in rooms - {"__pycache__"}:
        assert re.search(rf"\b{room}\b", ROOMS), room


def test_links_lead_somewhere() -> None:
    targets = re.findall(r"\]\(([^)]*)\)", TEXT)
    assert targets
    for target in targets:
        assert (ROOT / target).is_file()


def test_the_two_commands_are_the_integrations() -> None:
    install, test = blocks(TEXT, "")[0].splitlines()
    assert "-m venv .venv" in install
    assert "orthocal solve sample_data/" in install
    assert test.endswith("-m pytest -n 2")
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert '"$python" -m pytest -n 2\n' in script
