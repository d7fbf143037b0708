"""One decision: mark, verdict, release and exit code are the same in every command."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orthoglide_cal.cli import common
from orthoglide_cal.estimation.solution import pose
from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.machine_file import machine_text
from orthoglide_cal.files.readings import GaugeIdentity
from orthoglide_cal.inference.alone import solve
from orthoglide_cal.inference.data import Whitened
from orthoglide_cal.inference.result import Verdict
from orthoglide_cal.model.orthoglide import JointOffsets
from orthoglide_cal.results.making import answer_to
from tests.cli.program import DOUBLE, SAMPLES, SIX, UNDETERMINED, answer, lines, run
from tests.machines import NOMINAL
from tests.printer_files import OFF, printer_cfg
from tests.results import cases
from tests.results.sessions import FINE, TRUE, session, write
from tests.truth.delta import V400

SIGNS = {"good": "✔", "warn": "!", "bad": "✘", "open": "?"}
MARKS = tuple(f"{sign} " for sign in SIGNS.values())


def overdue(path: Path) -> None:
    gauge = GaugeIdentity(id="no. 41", certificate="2026-0117", due="2025-12-31")
    write(session(TRUE, 3), NOMINAL, path, gauges=(gauge,), finished="2026-03-03T09:31:00+01:00")


def calibrated(path: Path) -> None:
    """The controller has what is true, within a few micrometres."""
    machine = FINE.machine.changed(offsets_mm=JointOffsets(0.1, 0.2, -0.3))
    model = replace(FINE, machine=machine)
    write(session(np.array([0.002, -0.001, 0.003]), 5, model), model, path)


def unexplained(path: Path) -> None:
    given = cases.unexplained().given
    write(replace(given.measured, value=np.round(given.measured.value, 3)), given.model, path)


# File → how it is made, its mark, whether anything is to be entered, its first code.
FILES: dict[str, tuple[Callable[[Path], object], str, bool, str]] = {
    "healthy.yaml": (lambda path: write(session(TRUE, 3), NOMINAL, path), "good", True, ""),
    "overdue.yaml": (overdue, "warn", True, "overdue_gauge"),
    "six.csv": (partial(shutil.copy, SIX), "open", True, "undecided"),
    "unexplained.yaml": (unexplained, "bad", True, "unexplained"),
    "steady.yaml": (lambda path: write(replace(session(TRUE, 3), value=np.full(60, 0.12)), NOMINAL,
                                       path), "bad", True, "gauge_doubt"),
    "calibrated.yaml": (calibrated, "good", False, ""),
    "printer.cfg": (lambda path: path.write_text(printer_cfg(V400, OFF)), "warn", True,
                    "nozzle_lower"),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_every_command_says_the_same(name: str) -> None:
    make, tone, needed, code = FILES[name]
    make(Path(name))
    usable = tone in ("good", "warn")
    for verb in ("solve", "diagnose", "report", "export"):
        shown = run(verb, name)
        assert shown.exit_code == (0 if usable or verb == "diagnose" else 4), shown.stderr
        marked = [line for line in shown.stdout.splitlines() if line.startswith(MARKS)]
        if verb == "export":
            assert bool(shown.stdout) is usable
        else:
            assert marked[0].startswith(SIGNS[tone]), shown.stdout
            assert "Consistent" not in marked[0] or usable
        if usable:
            assert ("Nothing to enter" in shown.stdout) is not needed, verb
    solved, diagnosed = answer("solve", name), answer("diagnose", name)
    reported, exported = answer("report", name)["answer"], answer("export", name, "--force")
    for other in (diagnosed, reported, exported):
        assert other == solved
    release = solved["release"]
    assert (release["usable"], release["needed"]) == (usable, needed)
    assert release["settled"] is not needed
    assert (release["codes"] or [""])[0] == code
    assert len(release["codes"]) == len(release["reasons"]) + len(release["cautions"])
    for parameter in solved["parameters"]:
        entered = parameter["enter"]
        assert (entered is not None) is usable
        assert needed or entered == parameter["active"]
    if usable and not needed:
        written = run("export", name).stdout
        assert "After entering" not in written
        names = {parameter["name"] for parameter in solved["parameters"]}
        words = [line.replace(",", " ").split() for line in written.splitlines()]
        rows = [row[-4:] for row in words if row and row[0] in names]
        assert len(rows) == len(names)
        assert all(entered == previous for previous, _, _, entered in rows)
    if name.endswith(".cfg"):
        applied = run("apply", name, "--to", name, "--yes")
    else:
        Path("machine.yaml").write_text(machine_text(read_input(name).model))
        applied = run("apply", name, "--yes", "--machine", "machine.yaml")
    assert applied.exit_code == (0 if usable else 4), applied.stderr
    assert ("Nothing was changed" in applied.stderr) is (usable and not needed)


def test_data_without_a_solution_have_the_same_answer() -> None:
    """JSON says why; on a screen both end with the reason."""
    both = [run(verb, "-", "--json", text=UNDETERMINED) for verb in ("solve", "diagnose")]
    assert [shown.exit_code for shown in both] == [4, 4]
    (solved,), (diagnosed,) = map(lines, both)
    assert diagnosed == solved
    assert solved["release"]["codes"] == ["refused"]


def test_where_nothing_is_needed_nothing_is_asked_of_the_record() -> None:
    """Other offsets were entered since: that would refuse a record, and there is none."""
    calibrated(Path("s.yaml"))
    model = read_input("s.yaml").model
    Path("machine.yaml").write_text(machine_text(model.holding((1.0, 2.0, 3.0))))
    applied = run("apply", "s.yaml", "--yes", "--json")
    assert applied.exit_code == 0, applied.output
    (told,) = lines(applied)
    active = dict(zip("xyz", model.machine.active, strict=True))
    assert (told["before"], told["after"], told["date"]) == (active, active, None)
    assert "Nothing to enter" in applied.stderr
    assert not told["simulated"]
    run("machine", "new", "--practice", "--yes", "--output", "practice.yaml")
    run("simulate", "--seed", "1", "--output", "one.yaml", "--machine", "practice.yaml")
    (told,) = lines(run("apply", "one.yaml", "--machine", "practice.yaml", "--json", "--yes"))
    assert (told["simulated"], told["date"]) == (True, None)


@pytest.mark.parametrize(
    "command",
    [
        "solve DOUBLE", "plan DOUBLE", "report DOUBLE --after OTHER --applied 1 0 0",
        "verify DOUBLE OTHER --applied 1 0 0", "history DOUBLE OTHER", "apply DOUBLE --yes",
    ],
)  # fmt: skip
def test_what_may_take_long_is_shown_as_work(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """All inference begins with the data made comparable; of these paths nothing is known yet."""
    at_work, shown = list[str](), list[int]()

    @contextmanager
    def working(what: str) -> Iterator[None]:
        at_work.append(what)
        yield
        at_work.pop()

    def noting(work: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *given, **options: shown.append(len(at_work)) or work(*given, **options)

    Path("machine.yaml").write_text(machine_text(NOMINAL))
    monkeypatch.setattr(common, "working", working)
    monkeypatch.setattr(Whitened, "of", noting(Whitened.of))
    shutil.copy(DOUBLE, "DOUBLE")
    text = Path("DOUBLE").read_text(encoding="utf-8")
    Path("OTHER").write_text(text.replace("y,0.1,1", "y,0.11,1", 1), encoding="utf-8")
    typed = [Path.cwd() / word if Path(word).exists() else word for word in command.split()]
    assert run(*typed).exit_code in (0, 4)
    assert shown
    assert set(shown) == {1}


def test_equal_quantities_are_equal_to_the_last_digit() -> None:
    """What the offsets alone leave has one number, wherever it is said."""
    for make in (cases.healthy, cases.named_in_machine, cases.single, cases.unexplained):
        solved = make().answer
        lack = solved.lack_of_fit
        residuals = [row.measured_mm - row.modelled_mm for row in solved.residuals]
        assert float(np.sqrt(np.mean(np.square(residuals)))) == pytest.approx(
            lack.left_mm, rel=1e-12
        )
        assert {pattern.rms_before_mm for pattern in solved.patterns} <= {lack.left_mm}
        assert {one.rms_after_mm for one in solved.patterns if one.accepted} <= {
            solved.rms.after_mm
        }
        if not solved.release.needed:
            assert {row.measured_mm - row.expected_mm for row in solved.deviations} == {0.0}
        assert {cause.rms_after_mm for cause in solved.causes} <= {solved.rms.after_mm}
        if solved.alone is not None:
            assert solved.alone.rms_after_mm == lack.left_mm
            assert {cause.rms_before_mm for cause in solved.causes} == {lack.left_mm}
        elif solved.verdict == "consistent":
            assert solved.rms.after_mm == lack.left_mm


def test_undecided_the_residual_is_that_of_the_values_shown() -> None:
    """Six differences: what the model leaves of them at the mean of what is open."""
    for k in (1, 2, 3):
        given = read_input(str(SAMPLES / f"experiment{k}.csv"))
        shown = answer_to(given)
        assert shown.verdict is Verdict.AMBIGUOUS
        problem, data = pose(given.measured, given.model, given.measured.kind)
        values = np.array([parameter.found for parameter in shown.parameters])
        left = data - problem.predict(values)
        assert shown.rms.after_mm == pytest.approx(float(np.sqrt(np.mean(left**2))), rel=1e-12)
        alone = solve(given.measured, given.model)
        assert shown.rms.after_mm > alone.rms_after_mm
