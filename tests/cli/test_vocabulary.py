"""No command prints an order that another refuses, and what is printed to type works as it is.

Every sample file and sessions of the independent truth are walked through all commands that speak
of a result, with names that need quoting; then every command that they print is run.
"""

import re
import shlex
import shutil
from collections.abc import Iterator
from contextlib import chdir
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from typer.testing import Result

from orthoglide_cal.files.machine_file import default_machine, machine_text, shipped_folder
from tests import truth
from tests.cli.program import READINGS, done, run, written
from tests.machines import SAMPLES
from tests.session.terminal import run_program

SAMPLE_FILES = sorted(path.name for path in SAMPLES.iterdir() if path.suffix in (".csv", ".yaml"))
SPEAKING = ("solve", "diagnose", "report", "export")
ORDERS = ("Enter the offsets", "may be entered", "HOME_OFFSET")
COMMAND = re.compile(r"(?:^|[\s`>])orthocal ([a-z]+ [^\n`]+)")


def said(result: Result) -> str:
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return result.stdout + result.stderr


def printed(text: str) -> set[str]:
    return {found.strip() for found in COMMAND.findall(text)}


def read_again(path: str) -> str:
    """A file with the same readings but for the first, which has one more digit."""
    text = Path(path).read_text(encoding="utf-8")
    head = re.search(r"^(.*,)?(reading|value)_mm\b", text, re.MULTILINE)
    before = "" if head is None else rf"^(?:[^,\n]*,){{{head[0].count(',')}}}"
    first = rf"({before or 'reading_mm: '})(-?\d+\.\d+)"
    changed = re.sub(first, r"\1\g<2>1", text, count=1, flags=re.MULTILINE)
    assert changed != text
    target = Path(path).with_name(f"again-{Path(path).name}.txt")
    target.write_text(changed, encoding="utf-8")
    return str(target)


def walk(*given: str) -> Iterator[str]:
    """All that is said of one input: no order where `export` refuses; what is typed works."""
    released = run("export", *given).exit_code == 0
    texts = {verb: said(run(verb, *given)) for verb in SPEAKING}
    for verb, text in texts.items():
        orders = [order for order in ORDERS if order in text]
        assert bool(orders) == (released and verb != "export"), (verb, orders, text)
    typed = set().union(*(printed(text) for text in texts.values()))
    assert typed or not released
    kept = [command for command in sorted(typed) if command.startswith("apply ")]
    # What was entered is typed a second time only where no file keeps it.
    verified = [command for command in typed if command.startswith("verify ")]
    assert all(("--applied" in command) != bool(kept) for command in verified), verified
    measured = {command for command in typed if command.startswith(("measure ", "adjust "))}
    for command in sorted(typed - set(kept) - measured):
        after = read_again(given[0])
        told = [after if word == "AFTER" else word for word in shlex.split(command)]
        found = recorded(kept[0], *told) if kept and told[0] == "verify" else run(*told)
        # The same readings once more: the machine did not do what was entered.
        refused = told[0] == "verify" or (told[0] == "solve" and not released)
        assert found.exit_code == (4 if refused else 0), (command, said(found))
        yield said(found)


def recorded(record: str, *told: str) -> Result:
    """A command after `apply` and its yes, in a copy of this folder."""
    with TemporaryDirectory() as copy:
        shutil.copytree(Path(), copy, dirs_exist_ok=True)
        with chdir(copy):
            entered = run(*shlex.split(record), "--yes")
            assert entered.exit_code == 0, (record, said(entered))
            # Nothing is offered that is done already.
            assert not any(c.startswith("apply ") for c in printed(said(run("solve", told[1]))))
            return run(*told)


def walk_on(*given: str) -> int:
    """The same, and on with every machine file that was written on the way; how many walks."""
    ready = set(Path().glob("*.yaml"))
    for _ in walk(*given):
        pass
    made = sorted(set(Path().glob("*-*.yaml")) - ready)
    return 1 + sum(walk_on(given[0], "--machine", str(machine)) for machine in made)


# The paper's other experiments are six differences like these of the second.
@pytest.mark.parametrize("name", sorted({*SAMPLE_FILES} - {"experiment1.csv", "experiment3.csv"}))
def test_samples(name: str) -> None:
    shutil.copy(SAMPLES / name, f"my {name}")
    # The session's gap is accepted, and that machine file is walked, too.
    assert walk_on(f"my {name}") == (2 if name == "session.yaml" else 1)


def test_in_a_folder_with_its_machine_what_is_entered_is_recorded() -> None:
    shutil.copy(SAMPLES / "double_posture_session.csv", READINGS)
    Path("machine.yaml").write_text(machine_text(default_machine()), encoding="utf-8")
    for given in (("solve", READINGS, "--details"), ("report", READINGS), ("export", READINGS)):
        commands = printed(said(run(*given)))
        assert {f"apply '{READINGS}'", f"verify '{READINGS}' AFTER"} <= commands
    assert walk_on(READINGS) == 1


def test_where_no_machine_file_can_keep_it_the_command_says_what_was_entered() -> None:
    """None here, that of another machine, one that comes with the program, several."""
    shutil.copy(SAMPLES / "double_posture_session.csv", READINGS)
    shipped = str(shipped_folder() / "orthoglide_prototype.yaml")
    done("simulate", "--offsets", "0.4", "-0.3", "0.8", "--seed", "1", "-o", "s.yaml")
    other = machine_text(default_machine()).replace("Orthoglide prototype", "Mill 3")
    for given in ((READINGS,), (READINGS, "--machine", shipped), ("s.yaml",)):
        if given[0] == "s.yaml":
            Path("machine.yaml").write_text(other, encoding="utf-8")
        text = said(run("solve", *given))
        assert "orthocal apply" not in text
        machine = f" --machine {shlex.quote(shipped)}" if len(given) > 1 else ""
        assert f"AFTER{machine} --applied " in text
    Path("second.yaml").write_text(other, encoding="utf-8")
    assert "--applied" in said(run("solve", "s.yaml"))


def test_a_session_of_the_truth() -> None:
    """A cause of the measurement, which no sample has."""
    walk_on(*written(truth.make_session(1, truth.PROTOTYPE, truth.MICRON, ("misread",))))


def test_a_session_ends_with_what_solve_says_of_it() -> None:
    path = "my session.yaml"
    measured = run_program(Path(), path, "--gauge", "simulated", "--seed", "1")
    assert measured.returncode == 0
    solved = said(run("solve", path))
    assert solved.strip() in measured.stdout
    assert printed(measured.stdout) == printed(solved)


def test_another_method_stays_the_method() -> None:
    shutil.copy(SAMPLES / "double_posture_session.csv", READINGS)
    text = said(run("solve", READINGS, "--method", "six", "--details"))
    typed = {command for command in printed(text) if command.startswith("export")}
    assert typed == {f"export '{READINGS}' --method six --format linuxcnc"}
    (command,) = typed
    assert run(*shlex.split(command)).exit_code == 0


@pytest.mark.slow
@pytest.mark.parametrize(("machine", "gauge"), list(product(truth.MACHINES, truth.GAUGES)))
@pytest.mark.parametrize("hidden", [(), *((cause,) for cause in truth.CAUSES), *truth.OUTSIDE])
def test_sessions_of_the_bench(machine: str, gauge: str, hidden: tuple[str, ...] | str) -> None:
    outside = hidden if isinstance(hidden, str) else None
    causes = () if isinstance(hidden, str) else hidden
    for seed in range(3):
        for path in Path().iterdir():
            path.unlink()
        session = truth.make_session(
            seed, truth.MACHINES[machine], truth.GAUGES[gauge], causes, outside
        )
        walk_on(*written(session))
