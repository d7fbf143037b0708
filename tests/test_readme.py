"""The README's examples are run, and what it shows is what the program prints."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from tests.cli.program import run
from tests.machines import ROOT

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
COMMANDS = [block for kind, block in BLOCKS if kind == "sh"]
SHOWN = [block for kind, block in BLOCKS if kind == "text"]


@pytest.fixture(autouse=True)
def _copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("sample_data", "configs"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("block", COMMANDS)
def test_commands_run(block: str) -> None:
    for line in block.splitlines():
        program, *arguments = shlex.split(line)
        assert program == "orthocal"
        shown = run(*arguments)
        assert shown.exit_code == 0, shown.stderr
        assert shown.stdout or "--output" in arguments


def test_the_shown_answer_is_the_programs() -> None:
    shown = run("solve", "sample_data/double_posture_session.csv").stdout
    assert SHOWN[0] in shown


def test_the_shown_readings_are_a_readings_file(tmp_path: Path) -> None:
    Path("mine.csv").write_text(SHOWN[1], encoding="utf-8")
    assert run("validate", "mine.csv").exit_code == 0


def test_the_python_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = (block for kind, block in BLOCKS if kind == "python")
    exec(compile(code, "README.md", "exec"), {})
    assert "what this gauge's noise would give" in capsys.readouterr().out


def test_sections_exist_for_every_command() -> None:
    commands = [line.split()[0] for line in run("--help").stdout.split("Commands:")[1].splitlines()
                if line.strip()]  # fmt: skip
    for command in commands:
        assert f"orthocal {command}" in TEXT


def test_links_within_the_page_lead_somewhere() -> None:
    headings = {
        re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")
        for title in re.findall(r"^#+ (.*)$", TEXT, re.MULTILINE)
    }
    assert set(re.findall(r"\]\(#([^)]*)\)", TEXT)) <= headings


def test_the_two_commands_are_the_integrations() -> None:
    install, test = next(block for _, block in BLOCKS).splitlines()
    assert "-m venv .venv" in install
    assert "orthocal solve sample_data/" in install
    assert test.endswith("-m pytest -n 2")
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert '"$python" -m pytest -n 2\n' in script
