"""One screen: what commands print without --details at 80 columns, for what can be hidden."""

import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from rich.cells import cell_len

from orthoglide_cal.files.input import Input, read_input
from orthoglide_cal.files.machine_file import machine_text, read_machine_file, shipped_folder
from orthoglide_cal.inference.diagnose import diagnose
from orthoglide_cal.inference.result import Verdict
from orthoglide_cal.planning.next_measurement import rank_measurements
from orthoglide_cal.planning.plan import chosen_session, measurement_plan
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import Case
from orthoglide_cal.report.documents.answer import diagnosis_document, headline, solution_document
from orthoglide_cal.report.documents.plan import plan_document
from orthoglide_cal.report.documents.reports import verification_document
from orthoglide_cal.results.answer import RETAKE, Remedy
from orthoglide_cal.results.making import answer_to
from tests import truth
from tests.cli.program import done
from tests.inference.sessions import given
from tests.inference.test_printers import quartic
from tests.machines import NOMINAL, SAMPLES
from tests.report.test_terminal import shown, unwrapped
from tests.results.cases import as_left, named_in_machine, named_in_measurement, unexplained
from tests.results.sessions import TRUE, session, write
from tests.truth import delta

SAMPLE_FILES = sorted(path.name for path in SAMPLES.iterdir() if path.suffix in (".csv", ".yaml"))
slow = pytest.mark.slow
SINGLE = [(), *((cause,) for cause in truth.CAUSES)]
PAIRS = [("axis_gap", "swapped_gauges"), ("bar_skew", "misread"), ("encoder_scale", "axis_gap")]
PRINTER_PAIRS = [("tower_lean", "bed_shape"), ("bed_shape", "misread")]
MOST = {"solve": 24, "refused": 20, "diagnose": 30, "undecided": 20, "plan": 24, "verify": 24}


def screen(document: doc.Document, most: int) -> list[str]:
    """The lines of the screen, which are few, and none too wide but what is typed."""
    page = document.screen()
    lines, kept = shown(page).splitlines(), unwrapped(page)
    text = "\n".join(lines)
    assert len(lines) <= most, f"{len(lines)} lines:\n{text}"
    for line in lines:
        assert cell_len(line) <= 80 or any(typed in line for typed in kept), text
    return lines


def both_screens(case: Case) -> str:
    """Of solve and diagnose, as many lines as their verdicts allow; one decision in both."""
    answer = case.answer
    said = ""
    if answer.parameters:
        usable = answer.release.usable
        few = MOST["refused"] + len(answer.parameters) - 3
        lines = screen(solution_document(case), MOST["solve"] if usable else few)
        enter = usable and not answer.release.settled
        assert any(re.search(r" {2}enter( |$)", line) for line in lines) == enter, lines
        assert ("apply" in "\n".join(lines)) <= enter
        said = "\n".join(lines)
    undecided = answer.verdict is Verdict.AMBIGUOUS
    lines = screen(diagnosis_document(case), MOST["undecided" if undecided else "diagnose"])
    assert ("Do not enter" in "\n".join(lines)) == (not answer.release.usable), lines
    return f"{said}\n\n" + "\n".join(lines)


def answered(read: Input) -> Case:
    """With the answer of a plain screen."""
    return Case(read, answer_to(read))


@cache
def of_orthoglide(hidden: tuple[str, ...], seed: int, gauge: str, outside: str | None) -> Case:
    session = truth.make_session(seed, truth.PROTOTYPE, truth.GAUGES[gauge], hidden, outside)
    return answered(given(session))


@cache
def of_printer(hidden: tuple[str, ...], seed: int, places: int) -> Case:
    layout = delta.Layout(places)
    return answered(given(delta.make_delta_session(seed, hidden=hidden, layout=layout)))


@pytest.mark.parametrize("name", SAMPLE_FILES)
def test_samples(name: str) -> None:
    both_screens(answered(read_input(str(SAMPLES / name), None, lambda: NOMINAL)))


@pytest.mark.parametrize(
    ("cause", "seed", "gauge", "outside"),
    [
        *((cause, 1, "micron", None) for cause in SINGLE),
        (("bar_skew", "swapped_gauges"), 4, "micron", None),  # one step, and much to say of it
        *(pytest.param(cause, 2, "micron", None, marks=slow) for cause in (*SINGLE, *PAIRS)),
        *(pytest.param(cause, 3, "dial", None, marks=slow) for cause in (*SINGLE, *PAIRS)),
        *(pytest.param((), 1, "micron", outside, marks=slow) for outside in truth.OUTSIDE),
    ],
    ids=str,
)
def test_causes_of_an_orthoglide(
    cause: tuple[str, ...], seed: int, gauge: str, outside: str | None
) -> None:
    both_screens(of_orthoglide(cause, seed, gauge, outside))


def test_of_several_faults_that_do_not_show_the_screen_has_the_names() -> None:
    case = of_orthoglide(("bar_skew",), 15, "dial", None)
    (fault,) = case.answer.unshown
    faults = (fault.changed(id="sign_flip", where="leg x, along y"), fault)
    said = both_screens(Case(case.given, case.answer.changed(unshown=faults)))
    told = r"cannot show sign_flip \(.+?\) or swapped_gauges \(.+?\)\. How to check: --details"
    assert re.search(told, " ".join(said.split()))


@pytest.mark.parametrize("number", [1, 2, 3])
def test_what_is_undecided_adds_up(number: int) -> None:
    """The most probable first, 100 % in all; the offsets alone lead the table."""
    path = str(SAMPLES / f"experiment{number}.csv")
    case = answered(read_input(path, None, lambda: NOMINAL))
    lines = screen(diagnosis_document(case), MOST["undecided"])
    said = " ".join(" ".join(lines).split())
    title = said.partition("Undecided: ")[2].partition(" Orthoglide")[0]
    shares = [int(share) for share in re.findall(r"\((\d+) %\)", title)]
    assert sum(shares) == 100
    assert shares[:3] == sorted(shares[:3], reverse=True)
    patterns = [each.probability for each in case.answer.explanations if each.pattern]
    assert ("that is not on the list, such as a repeating deviation (" in title) == bool(patterns)
    assert re.search("r.m.s. left.*\n  offsets only ", "\n".join(lines))
    fitted = [state for state in case.answer.explanations if state.parameters]
    alike = case.answer.changed(explanations=[e.changed(probability=0.337) for e in fitted[:2]])
    assert re.findall(r"(\d+) %", headline(replace(case, answer=alike))) == ["34", "34", "32"]


def test_a_headline_says_what_looks_the_same() -> None:
    case, alike = named_in_measurement(), {("misread",): 0.46, ("stand_shift",): 0.51}
    causes = tuple(cause.changed(alike=alike) for cause in case.answer.causes)
    said = headline(replace(case, answer=case.answer.changed(causes=causes)))
    assert said.endswith("is wrong (misread 46.0 % or stand_shift 51.0 %)")


def test_residuals_of_a_named_cause_are_not_those_after_entering() -> None:
    answer = named_in_machine().answer
    assert answer.alone is not None
    assert answer.rms is not None
    sizes = answer.rms.before_mm, answer.alone.rms_after_mm, answer.rms.after_mm
    before, alone, left = (f"{mm:.4f}" for mm in sizes)
    said = " ".join(" ".join(screen(solution_document(named_in_machine()), 20)).split())
    assert f"{before} mm r.m.s. before, {alone} with offsets only, {left} with axis_gap." in said
    asked = Case(unexplained().given, answer_to(unexplained().given, "six"))
    assert "offsets only" not in " ".join(screen(solution_document(asked), 30))


def test_what_a_named_cause_asks_for() -> None:
    """The record before the machine, how a reading is wrong, and no offset before that."""
    said = both_screens(of_orthoglide(("misread",), 1, "micron", None))
    assert re.search(r"misread at .+?: \d\.\d+ ± \d\.\d+ mm\s+too (high|low)\.", said)
    assert re.search(r"\d\. Then solve again, and enter only what it releases\.", said)
    said = both_screens(of_orthoglide(("sign_flip", "axis_gap"), 1, "micron", None))
    assert said.index("Check which way + is") < said.index("Shim the rails")


@pytest.mark.parametrize(
    ("cause", "seed", "places"),
    [
        *(((cause,), 1, 49) for cause in ("leg_length", "tower_lean", "bed_shape", "misread")),
        *(
            pytest.param(cause, 2, places, marks=slow)
            for cause in ((), *((cause,) for cause in delta.TOLERANCES), *PRINTER_PAIRS)
            for places in (7, 121)
        ),
    ],
    ids=str,
)
def test_causes_of_a_printer(cause: tuple[str, ...], seed: int, places: int) -> None:
    both_screens(of_printer(cause, seed, places))


@pytest.mark.parametrize("machine", ["orthoglide_prototype.yaml", "linear_delta.yaml"])
def test_a_plan(machine: str) -> None:
    model = read_machine_file(shipped_folder() / machine).model
    screen(plan_document(measurement_plan(chosen_session(model))), MOST["plan"])


def test_what_was_questioned_and_kept_is_retaken_first() -> None:
    case = of_orthoglide(("thermal_drift",), 14, "micron", None)
    assert case.answer.verdict is Verdict.AMBIGUOUS
    again = Remedy.of("do", "measure", RETAKE, what="Retake: r 14")
    release = case.answer.release
    kept = case.answer.changed(release=release.changed(remedies=(again, *release.remedies)))
    for said in both_screens(Case(case.given, kept)).split("\nNext\n")[1:]:
        assert re.match(r" +1\. Retake: r 14 +orthocal measure session.csv --resume", said), said


def test_what_to_measure_next() -> None:
    read = read_input(str(SAMPLES / "experiment1.csv"), None, lambda: NOMINAL)
    diagnosis = diagnose(read.measured, read.model)
    plan = measurement_plan(chosen_session(read.model), None, rank_measurements(diagnosis))
    begun = Case(read, answer_to(read, diagnosed=diagnosis))
    screen(plan_document(plan, None, begun), MOST["plan"])


def test_a_verification() -> None:
    screen(verification_document(as_left()[1]), MOST["verify"])


def test_the_folder_never_asks_to_apply_what_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("machine.yaml").write_text(machine_text(NOMINAL), encoding="utf-8")
    shutil.copy(SAMPLES / "session.yaml", "refused.yaml")
    said = done()
    assert "Do not enter these offsets" in said
    assert "orthocal diagnose refused.yaml" in said
    assert "apply" not in said
    # One that may be entered is to be applied; both are few lines.
    write(session(TRUE, 4), NOMINAL, Path("later.yaml"), finished="2099-01-01T00:00:00+00:00")
    assert "orthocal apply later.yaml" in done()
    assert len(said.splitlines()) <= MOST["solve"]


def test_on_one_height_a_shape_is_not_called_a_cause() -> None:
    """And what predicts better without a cause is the first step."""
    bent = delta.Truth(bed=quartic(np.random.default_rng(2), 0.08))
    layout, rng = delta.Layout(61), np.random.default_rng(1)
    read = given(delta.probe_bed(delta.V400, bent, (), layout, rng))
    diagnosis = diagnose(read.measured, read.model)
    case = Case(read, answer_to(read, diagnosed=diagnosis))
    assert re.search(
        r"! A smooth shape is left \(\d\d µm\): bed_shape, \d\d\.\d %", both_screens(case)
    )
    # A mesh in the controller does correct it.
    assert "no controller corrects it" not in shown(diagnosis_document(case).page())
    better = replace(diagnosis, baselines=diagnosis.baselines.changed(quartic_mm=0.001))
    said = both_screens(Case(read, answer_to(read, diagnosed=better)))
    assert "1. Make a bed mesh: a quartic surface predicts within 1.0 µm" in said
