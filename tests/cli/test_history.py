"""`history` from the command line: a folder, one screen, a page, JSON, what is refused."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.cells import cell_len

from orthoglide_cal.files.readings import session_of_readings, session_text
from tests.cli.program import answer, done, holds, refused, run, words
from tests.results.histories import draw
from tests.results.test_schema import CONTRACT
from tests.truth.delta import KOSSEL, Layout, delta_csv, delta_yaml, make_delta_session, probe_bed


def written(story: str, count: int) -> None:
    for given in draw(story, 5, count).inputs:
        day = given.conditions.started
        session = session_of_readings(given.measured, given.model, {})
        text = session_text(session.model_copy(update={"started": day}))
        Path(f"{day[:10]}.yaml").write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    ("story", "count", "says", "changed"),
    [
        ("step", 4, "! Changed between 2026-", True),
        ("unchanged", 3, "✔ Unchanged in 3 sessions", False),
        ("step and drift", 7, "in 30 days", True),
        ("scatter", 4, "Scattering from session to session", False),
        ("cause", 4, "axis_", True),
    ],
)
def test_one_screen_says_what_happened(story, count, says, changed):
    written(story, count)
    shown = done("history", ".")
    lines = shown.splitlines()
    assert len(lines) <= 24, shown
    assert max(map(cell_len, lines)) <= 80
    assert says in words(shown)
    assert "best now" in shown
    assert ("----------" in shown) == changed
    # What it prints to type works.
    (typed,) = [line.partition("orthocal ")[2] for line in lines if "orthocal solve" in line]
    assert run(*typed.split()).exit_code in (0, 4)


def test_a_screen_is_full_before_a_session_is_left_out():
    count = 18
    written("scatter", count)
    lines = done("history", ".").splitlines()
    shown = [path.stem for path in Path().iterdir() if f"  {path.stem}  " in "\n".join(lines)]
    left_out = [int(line.split()[1]) for line in lines if line.strip().startswith("…")]
    assert len(shown) + sum(left_out) == count
    assert min(left_out) >= 2
    assert 23 <= len(lines) <= 24


def test_json_and_page_say_the_same():
    written("step", 4)
    found = answer("history", ".", "--limit", "0.5")
    assert set(found) >= set(CONTRACT["history"].split())
    (change,) = found["changes"]
    files = [session["path"] for session in found["sessions"]]
    assert files.index(change["after"]) == files.index(change["before"]) + 1
    assert found["limit"]["limit_mm"] == 0.5
    run("history", *reversed(files), "--html", "page.html", "--limit", "0.5")
    page = Path("page.html").read_text(encoding="utf-8")
    assert page.count(", from session to session: ") == 3  # descriptions of the plots
    assert change["parameters"][0]["name"] + ' <span class="nb">by ' in page
    for path in files:
        assert path.removesuffix(".yaml") in page
    every = done("history", ".", "--details")
    assert "further sessions" in every
    assert found["changes"] == answer("history", *files)["changes"]
    Path("broken.yaml").write_text("machine: {}\nreadings:\n\t{", encoding="utf-8")
    assert "Left out: broken.yaml" in words(run("history", ".").stderr)
    assert "Or leave it out" in refused(3, "history", "broken.yaml", *files)


def test_a_printer_is_compared_too():
    """Its touches as tables; the radius is another one from the second on."""
    machine = KOSSEL
    Path("machine.yaml").write_text(delta_yaml(machine), encoding="utf-8")
    for day in (2, 9, 16):
        session = make_delta_session(3, machine, (), Layout(places=37))
        if day > 2:
            longer = replace(session.truth, radius=session.truth.radius + 1.0)
            rng = np.random.default_rng(day)
            session = probe_bed(machine, longer, (), session.layout, rng)
        Path(f"touches_2026-03-{day:02}.csv").write_text(delta_csv(session), encoding="utf-8")
    files = sorted(map(str, Path().glob("*.csv")))
    found = answer("history", *files)
    assert found["verdict"] == "changed"
    assert found["changes"][0]["before"] == files[0]
    changed = {
        parameter["name"]: parameter["value"] for parameter in found["changes"][0]["parameters"]
    }
    assert changed["radius"] == pytest.approx(1.0, abs=0.2)
    run("history", *files, "--html", "page.html")
    assert "Residuals of the touches" in Path("page.html").read_text(encoding="utf-8")


def test_what_was_simulated_is_no_history():
    for number in (1, 2, 3, 4):
        done("simulate", "--seed", str(number), "-o", f"s{number}.csv")
    dates = ("--dates", "2026-03-02,2026-03-03,2026-04-01,2026-05-01")
    for number in (3, 4):
        marked = Path(f"s{number}.csv").read_text(encoding="utf-8")
        Path(f"m{number}.csv").write_text(marked.replace("yes", ""), encoding="utf-8")
    shown = words(done("history", "s1.csv", "s2.csv", "m3.csv", "m4.csv", *dates))
    holds(shown, ["Unchanged in 2 sessions, 2026-04-01 to 2026-05-01", "Left out: 2 simulated"])
    assert done("history", "s1.csv", "s2.csv").startswith("SIMULATED")
    assert answer("history", "s1.csv", "s2.csv")["simulated"] is True
    days = dates[1][:21]  # of one month
    assert ">03-03</text>" in done("history", "s1.csv", "s2.csv", "--dates", days, "--html", "-")
    assert "simulated and copied" in refused(2, "history", "s1.csv", "m3.csv")
    # One measurement counts once, under whatever name.
    shutil.copy("m3.csv", "m5.csv")
    shown = words(done("history", "m3.csv", "m4.csv", "m5.csv", "--dates", dates[1][:32]))
    assert "Left out: m5.csv (the readings of an earlier file, stored again)." in shown
