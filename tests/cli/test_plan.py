"""`orthocal plan`: what it promises is what is measured and solved then; what comes next."""

import csv
import html
import re
import shutil
import textwrap
from pathlib import Path

import pytest
import yaml

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.model.orthoglide import Orthoglide
from orthoglide_cal.planning.steps import GIVES_UP
from tests import truth
from tests.cli.program import DOUBLE, SIX, answer, lines, once, run, words, written
from tests.files.test_printer_file import GOOD
from tests.machines import ROOT
from tests.printers import CONFIG
from tests.results.test_schema import CONTRACT
from tests.session.terminal import run_program

OWN = [id for id, cause in CAUSES.items() if Orthoglide in cause.sizes]


def machine(folder: Path, **changes: object) -> str:
    shipped = (ROOT / "configs" / "orthoglide_prototype.yaml").read_text("utf-8")
    given = {**yaml.safe_load(shipped), **changes}
    path = folder / "mine.yaml"
    kept = {name: value for name, value in given.items() if value is not None}
    path.write_text(yaml.safe_dump(kept), encoding="utf-8")
    return str(path)


def test_the_json_is_that_of_the_contract() -> None:
    shown = once("plan", "--json")
    assert shown.stdout.count("\n") == 1
    (data,) = lines(shown)
    assert set(data) >= set(CONTRACT["plan"].split())
    assert "next" not in data  # without a file
    row = next(row for row in data["by_cycles"] if row["cycles"] == 3)
    assert row["readings"] == 60
    for key in ("noise_std_mm", "expanded_mm"):
        assert list(row[key]) == ["x", "y", "z"]
    assert row["minutes"] > 0.0
    count = len(OWN)
    assert len(data["separation"]) == count * (count - 1) // 2
    assert {id for pair in data["separation"] for id in pair["causes"]} == set(OWN)
    assert "leg_length" in data["invisible"]
    assert set(data["design"]) >= {"readings", "minutes", "gauge_at", "noise_std_mm"}
    assert data["limits"]["source"] == "leg_length"
    assert {way["method"] for way in data["compare"]} == {
        "single", "single-sequential", "six-linear", "twelve-linear", "six", "twelve", "readings",
    }  # fmt: skip


def test_a_target_takes_as_many_cycles_as_it_needs() -> None:
    (data,) = lines(once("plan", "--target", "0.022", "--json"))
    assert data["target"] == {"expanded_mm": 0.022, "reached": True, "cycles": data["cycles"]}
    reach = {row["cycles"]: max(row["expanded_mm"].values()) for row in data["by_cycles"]}
    assert reach[data["cycles"]] <= 0.022 < reach[6]
    shown = once("plan", "--target", "0.022").stdout
    assert f"± 0.022 mm takes {data['cycles']} cycles" in shown


def test_more_cycles_are_said_to_help_where_they_do(tmp_path: Path) -> None:
    gauge = {"resolution_mm": 0.01, "range_mm": 10, "repeatability_mm": 0.006}
    exact = {**gauge, "placement_mm": 0.01, "scale_u": 1e-6}
    path = machine(tmp_path, tolerances={"leg_length": 0.0}, gauge=exact)
    assert "more cycles help" in run("plan", "--machine", path).stdout
    coarse = {"resolution_mm": 0.5, "range_mm": 10.0, "repeatability_mm": 5.0}
    path = machine(tmp_path, gauge=coarse)
    noisy = words(run("plan", "--target", "0.1", "--machine", path).stdout)
    assert "It needs more than 50 cycles, because the readings scatter" in noisy


def test_a_machine_without_possible_causes_is_planned_for(tmp_path: Path) -> None:
    none = machine(tmp_path, tolerances=dict.fromkeys(OWN, 0.0))
    shown = run("plan", "--machine", none, "--details")
    assert shown.exit_code == 0
    assert "No cause leaves a trace." in shown.stdout
    only = machine(tmp_path, tolerances={**dict.fromkeys(OWN, 0.0), "axis_gap": 0.5})
    assert "A axis_gap" in run("plan", "--machine", only, "--details").stdout
    (data,) = lines(run("plan", "--machine", only, "--json"))
    assert data["separation"] == []


def test_what_it_says_to_type_can_be_typed(tmp_path: Path) -> None:
    path = machine(tmp_path)
    shown = run("plan", "--gauges", "1", "--machine", path).stdout
    assert f"orthocal measure --machine {path} --gauges 1" in shown
    shown = run("plan", "--design", "best", "--cycles", "5", "--machine", path).stdout
    assert f"orthocal measure --machine {path} --design best --cycles 5" in shown


def test_its_page_has_what_is_shown_and_short_facts() -> None:
    assert GIVES_UP in words(run("plan", "--details").stdout)  # as measure says it
    text = run("plan", "--html", "-").stdout
    assert ">█</td>" in text
    assert "A axis_gap" in text
    # A heading of 360 px shows two lines of about 27 characters of each fact.
    header = text.partition("<header>")[2].partition("</header>")[0]
    facts = [re.sub("<[^>]*>", "", fact) for fact in re.findall("<dd>(.*?)</dd>", header)]
    assert len(facts) >= 2
    assert all(len(textwrap.wrap(html.unescape(fact), 27)) <= 2 for fact in facts), facts


NAMES = ["a", "b", "c", "radius", "angle_a", "angle_b"]
MACHINE = ("--machine", str(CONFIG))


def test_the_json_is_that_of_the_contract_as_far_as_it_fits() -> None:
    (data,) = lines(run("plan", *MACHINE, "--json"))
    for row in data["by_cycles"]:
        assert list(row["parameters"]) == NAMES
        assert list(row["expanded_mm"]) == list(row["noise_std_mm"]) == NAMES[:4]
        assert row["minutes"] > 0.0
        for name in NAMES[:4]:
            assert row["parameters"][name]["expanded"] == row["expanded_mm"][name]
    sizes = {row["layout"]: row["readings"] for row in data["by_cycles"]}
    for count in (7, 13, 25, 121):
        assert sizes[f"bed-{count}"] == count
    assert data["protocol"] == "telling"
    design = data["design"]
    rivals = frozenset(("tower_lean", "bed_shape"))
    assert design["rivals_sigma"] > 4.5
    assert design["readings"] == sizes["telling"]
    pairs = {frozenset(pair["causes"]): pair["sigma"] for pair in data["separation"]}
    assert pairs[rivals] == pytest.approx(design["rivals_sigma"])
    assert "tower_radius" in data["invisible"]
    assert data["limits"]["source"] == "leg_length"
    flat = lines(run("plan", *MACHINE, "--layout", "bed-121", "--json"))[0]
    pairs = {frozenset(pair["causes"]): pair["sigma"] for pair in flat["separation"]}
    assert pairs[rivals] < 1.0


def test_the_page_of_a_printer_fits_a_terminal() -> None:
    shutil.copy(CONFIG, "delta.yaml")
    shown = run("plan", "--machine", "delta.yaml", "--details").stdout
    assert run("plan", *MACHINE, "--html", "plan.html").exit_code == 0
    assert "A leg_length" in Path("plan.html").read_text(encoding="utf-8")
    assert max(map(len, shown.splitlines())) <= 80
    # Each layout is one line of a table.
    table = shown[shown.index("  layout ") : shown.index("  U of each parameter: a in mm")]
    assert {len(line.split()) for line in table.replace("→ ", "").splitlines()} == {10}


def test_a_printers_own_file_is_a_machine_to_plan_for(tmp_path: Path) -> None:
    path = tmp_path / "printer.cfg"
    path.write_text(GOOD, encoding="utf-8")
    (data,) = lines(run("plan", str(path), "--data", "mesh", "--json"))
    assert data["machine"] == "printer.cfg"
    assert data["next"]
    text = run("plan", str(path), "--data", "mesh", "--program", "-").stdout
    rows = list(csv.DictReader(text.splitlines()))
    assert len(rows) == data["design"]["readings"]
    assert len({tuple(row[f"{name}_mm"] for name in "xyz") for row in rows}) == len(rows)


# A skewed bar that may as well be rails that do not meet.
OPEN = truth.make_session(7_100_014, truth.PROTOTYPE, truth.DIAL, ("bar_skew",))


def test_the_ranking_begins_with_what_diagnose_names() -> None:
    given = written(OPEN)
    plan, diagnosis = answer("plan", *given), answer("diagnose", *given)
    assert (diagnosis["verdict"], diagnosis["next_measurement"]) == ("ambiguous", plan["next"][0])
    # By the expected time; what stays open means coming back, eight hours later.
    lost = [option["minutes"] + 480.0 * (1.0 - option["chance"]) for option in plan["next"]]
    assert lost == pytest.approx(sorted(lost), rel=1e-12)


def test_what_would_not_show_but_matters_is_decided_by_the_next_measurement() -> None:
    """A gap that exchanged columns would turn into another: named, yet nothing to enter."""
    session = truth.make_session(7_100_001, truth.PROTOTYPE, truth.MICRON, ("axis_gap",))
    given = written(session)
    found = answer("diagnose", *given)
    following = found["next_measurement"]
    assert found["verdict"] == "named"
    assert following["between"] == [["axis_gap"], ["axis_gap", "exchanged_columns"]]
    said = " ".join(run("diagnose", *given).output.split())
    assert "--rule-out exchanged_columns" in said
    assert "it distinguishes axis_gap from axis_gap with exchanged_columns" in said
    assert "measure --then" in said
    assert "Next: about 2 min give one answer" in run("plan", *given).output
    (fault,) = found["unshown"]
    assert (fault["id"], fault["matters"]) == ("exchanged_columns", True)
    assert not found["release"]["usable"]
    ruled_out = ("diagnose", *given, "--rule-out", "exchanged_columns")
    checked = answer(*ruled_out)
    assert (checked["next_measurement"], checked["unshown"]) == (None, [])
    assert checked["ruled_out"] == ["exchanged_columns"]
    assert "Ruled out by hand: exchanged_columns" in run(*ruled_out).stdout
    assert run(*ruled_out[:-1], "nothing").exit_code == 2


def test_what_no_reading_tells_is_measured_again() -> None:
    """Beside a lost motion a stand that is gone may have crept: it is not looked for."""
    hidden = ("gauge_drift", "backlash")
    session = truth.make_session(7_500_005, truth.LARGE, truth.DIAL, hidden)
    page = run("diagnose", *written(session)).output
    said = " ".join(page.split())
    assert "is likely to decide. What is open lies in the measurement (" in said
    assert "leave the old readings out" in said
    assert "orthocal measure" not in page


def test_what_cannot_be_joined_is_followed_by_a_session_of_its_own() -> None:
    """The command that is shown measures it; it is solved alone, as was said."""
    shown = run("plan", SIX).stdout
    assert "measure --then" not in shown
    assert "It needs no old data" in " ".join(shown.split())
    (told,) = re.findall(r"^ +orthocal (measure.*)$", shown, re.MULTILINE)
    assert "double-posture, one cycle per leg" in words(shown.split("\nNext\n")[1])
    simulated = ("session.yaml", "--gauge", "simulated", "--seed", "4", "--yes")
    done = run_program(Path(), *told.split()[1:], *simulated)
    assert done.returncode in (0, 4), done.stderr
    found = answer("solve", "session.yaml")
    assert found["input"]["readings"] == 6 * (3 * 1 + 1)


def test_the_page_of_a_file_speaks_of_that_file() -> None:
    """What a session of its own would give stands apart, under its own heading."""
    shown = once("plan", DOUBLE, "--target", "0.022", "--details").stdout
    head, _, alone = shown.partition("A separate session would give")
    # However long its path is, and where it wraps.
    assert "".join(f"Readings {DOUBLE}, 60".split()) in "".join(head.split())
    assert "Session" not in head
    assert "are assumed" not in head
    assert "Session  double-posture" in alone
    assert "± 0.022 mm takes" in alone


def test_sound_readings_need_nothing_and_say_what_they_give() -> None:
    shown = run("plan", DOUBLE, "--details").stdout
    (solved,) = lines(run("solve", DOUBLE, "--json"))
    now = max(parameter["expanded"] for parameter in solved["parameters"])
    assert "✔ Nothing is undecided" in shown
    assert shown.index("1. See what to enter") < shown.index("2. Or, to reduce U: ")
    assert f"The largest is now ± {now:.3f} mm." in " ".join(shown.replace("│", " ").split())
    assert re.search(rf"^ +{now:.3f}  nothing: U as it is$", shown, re.MULTILINE)
    assert "half an hour is added for the session" in " ".join(shown.split())
