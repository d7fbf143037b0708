"""`plan FILE`: what to measure next, ranked; `diagnose` names the first of it."""

import re
from pathlib import Path

from tests import truth
from tests.cli.program import DOUBLE, SIX, answer, lines, once, run, words, written
from tests.session.terminal import run_program

# A skewed bar that may as well be rails that do not meet.
OPEN = truth.make_session(7_100_014, truth.PROTOTYPE, truth.DIAL, ("bar_skew",))


def test_the_ranking_begins_with_what_diagnose_names() -> None:
    given = written(OPEN)
    plan, diagnosis = answer("plan", *given), answer("diagnose", *given)
    first, *others = plan["next"]
    assert diagnosis["verdict"] == "ambiguous"
    assert diagnosis["next_measurement"] == first
    assert first["chance"] > 0.95
    # By the expected time; what stays open means coming back, eight hours later.
    lost = [each["minutes"] + 480.0 * (1.0 - each["chance"]) for each in plan["next"]]
    assert lost == sorted(lost)
    surest = max(each["chance"] for each in plan["next"])
    quicker = [each for each in plan["next"] if each["minutes"] < first["minutes"]]
    assert first["chance"] > 0.99 * surest
    assert all(each["chance"] < first["chance"] for each in quicker)
    assert others[-1]["chance"] < 0.5


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
    assert "No further reading of this kind is likely to decide. All of them are faults of" in said
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


def test_a_target_beside_a_file_is_answered() -> None:
    def said(target: str) -> str:
        shown = once("plan", DOUBLE, "--target", target).stdout.partition("\nNext\n")[0]
        return words(shown)

    (plan,) = lines(once("plan", DOUBLE, "--json"))
    able = [n for n in plan["next"] if max(n["expanded_mm"].values()) <= 0.022]
    quickest = min(able, key=lambda each: each["minutes"])
    assert f"± 0.022 mm takes about {quickest['minutes']:.0f} min: {quickest['what']}" in said(
        "0.022"
    )
    assert "± 0.03 mm is reached already." in said("0.03")
    assert "± 0.005 mm is reached by none of these." in said("0.005")


def test_sound_readings_need_nothing_and_say_what_they_give() -> None:
    shown = run("plan", DOUBLE, "--details").stdout
    (solved,) = lines(run("solve", DOUBLE, "--json"))
    now = max(each["expanded"] for each in solved["parameters"])
    assert "✔ Nothing needs to be measured" in shown
    assert shown.index("1. See what to enter") < shown.index("2. Or, to reduce U: ")
    assert f"Now it is ± {now:.3f} mm." in " ".join(shown.replace("│", " ").split())
    assert re.search(rf"^ +{now:.3f}  nothing: U as it is$", shown, re.MULTILINE)
    assert "half an hour is added for the session" in " ".join(shown.split())
