"""What the guide says about adding to the program is followed: a cause, and a kind of machine."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import orthoglide_cal
from tests.machines import ROOT
from tests.markdown import blocks, commands

SOURCE = Path(orthoglide_cal.__file__).parent
PAGE = (SOURCE / "guide" / "developing.md").read_text(encoding="utf-8")
OFFSETS = (0.4, -0.7, 0.2)


def texts(name: str) -> dict[str, str]:
    """Path as the page names it → what is written there; of a file that exists, what is added."""
    whole = Path(__file__).with_name(f"{name}.txt").read_text(encoding="utf-8")
    _, *parts = re.split(r"^=== (.+)\n", whole, flags=re.MULTILINE)
    return dict(zip(parts[::2], parts[1::2], strict=True))


def item(title: str) -> str:
    """What the page says under "To add something" of one thing."""
    (text,) = re.findall(rf"^### {title}\n(.*?)(?=^##|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    return text


def added(tmp_path: Path, said: str, word: str, name: str) -> Path:
    """A folder with a copy of the package to which exactly the files that are said are added."""
    files = texts(name)
    named = re.findall(r"^- `([\w./]+)`", said.replace(word, name), re.MULTILINE)
    assert named == list(files)
    package, touched = tmp_path / SOURCE.name, {path.split("/")[0] for path in files}
    package.mkdir()
    for folder in SOURCE.iterdir():
        if folder.name not in touched:
            (package / folder.name).symlink_to(folder)
    for name in touched:
        source, target = (ROOT, tmp_path) if name == "configs" else (SOURCE, package)
        shutil.copytree(source / name, target / name, ignore=shutil.ignore_patterns("__pycache__"))
    if "configs" not in touched:
        (tmp_path / "configs").symlink_to(ROOT / "configs")
    for path, text in files.items():
        at = (tmp_path if path.startswith("configs") else package) / path
        at.write_text((at.read_text(encoding="utf-8") if at.exists() else "") + text, "utf-8")
    return tmp_path


# Runs commands one after the other, each as a list of words, and then those that they advise;
# gives what each prints, and its exit code.
PROGRAM = """
import json, re, shlex, sys
from typer.testing import CliRunner
from orthoglide_cal.cli.app import app
typed, done = json.loads(sys.stdin.read()), []
for words in typed:
    one = CliRunner().invoke(app, words)
    done.append((words, one.stdout, one.exit_code, one.stderr))
    for line in re.findall("orthocal ([a-z].*)", one.stdout):
        advised = shlex.split(line.replace("AFTER", "after.csv"))
        advised += ["--yes"] * (advised[0] == "apply")
        typed += [advised] * (advised not in typed)
print(json.dumps(done))
"""


def run(folder: Path, *typed: list[str], refused: tuple[str, int] = ("", 0)) -> dict[str, str]:
    """What commands of that copy print, and those that they advise, in one process.

    Those that begin with the words of `refused` end with its exit code, the others with 0.
    """
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], input=json.dumps(typed),
        cwd=folder, env={**os.environ, "PYTHONPATH": str(folder), "COLUMNS": "200"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout)
    for words, _, code, error in results:
        expected = refused[1] if " ".join(words[:2]) == refused[0] else 0
        assert code == expected, f"{words}: {error}"
    return {" ".join(words): shown or error for words, shown, _, error in results}


def check(answer: dict, id: str, truth: dict[str, float]) -> None:
    """The cause is named, and all parameters are what they truly are."""
    assert answer["verdict"] == "named"
    (cause,) = answer["causes"]
    assert cause["id"] == id
    found = {each["name"]: each["found"] for each in answer["parameters"]}
    stds = {each["name"]: each["std"] for each in answer["parameters"]}
    for name, value in truth.items():
        assert abs(found[name] - value) < 4.5 * stds[name], name


def test_a_cause_is_one_class_and_its_page(tmp_path: Path) -> None:
    said = item("A cause")
    folder = added(tmp_path, said, "ID", "leg_sag")
    typed = [*commands("".join(blocks(said, "text")).replace("ID", "leg_sag"))]
    assert [words[0] for words in typed] == ["simulate", "diagnose", "guide"]
    simulate, diagnose, guide = typed
    _, shown, page = run(folder, simulate, [*diagnose, "--json"], guide).values()
    answer = json.loads(shown)
    check(answer, "leg_sag", dict(zip("xyz", OFFSETS, strict=True)))
    (cause,) = answer["causes"]
    assert answer["assumed"] == ["leg_sag"]
    assert cause["remedy"].startswith("Stiffen")
    for estimate, true in zip(cause["parameters"], (0.12, -0.17, 0.09), strict=True):
        assert estimate["unit"] == "mm"
        assert abs(estimate["value"] - true) < 4.5 * estimate["std"]
    assert "a leg sags" in page


def test_a_kind_of_machine_is_one_class_and_its_pages(tmp_path: Path) -> None:
    said = item("A kind of machine")
    folder = added(tmp_path, said, "KIND", "tilt_table")
    typed = [*commands("".join(blocks(said, "text")).replace("KIND", "tilt_table"))]
    assert [words[0] for words in typed] == ["machine", "simulate", "solve", "diagnose", "guide"]
    machine, simulate, solve, diagnose, guide = typed
    # Without the wrong reading they may be entered; afterwards there is nothing to enter.
    sound = [*simulate[: simulate.index("--cause")], "--output", "sound.csv"]
    zero = simulate.index("--offsets") + 1
    after = [*sound[:zero], "0", "0", "0", "--seed", "9", "--output", "after.csv"]
    of = [["sound.csv", *solve[2:]], ["after.csv", *solve[2:]]]
    first = machine, simulate, sound, after, solve, [*diagnose, "--json"], guide, ["solve", *of[0]]
    compare = ["verify", *of[0][:1], *of[1], "--applied", *map(str, OFFSETS), "--json"]
    pages = [*run(folder, *first, compare, refused=("solve one.csv", 4)).values()]
    solved, shown, page, entered, compared = pages[4 : len(first) + 1]
    assert [*json.loads(compared)["entered"].values()] == [*OFFSETS]
    assert "kind: tilt_table" in (folder / "mine.yaml").read_text(encoding="utf-8")
    assert "Do not enter these heights" in solved
    check(json.loads(shown), "misread", dict(zip("abc", OFFSETS, strict=True)))
    assert "A tilting table" in page
    assert "orthocal verify sound.csv AFTER --machine mine.yaml --applied 0.4" in entered
    for name in ("sound.csv", "after.csv"):
        table = (folder / name).read_text(encoding="utf-8")
        (folder / name).write_text(re.sub(",(simulated|yes)$", "", table, flags=re.MULTILINE))
    # Measured, they are recorded; what was not described cannot be planned, and nothing says so.
    typed = [*([verb, *data] for data in of for verb in ("solve", "diagnose")), ["plan"]]
    pages = run(folder, *typed, ["export", *of[0]], refused=("plan", 2))
    assert "No protocol guides through measuring a tilt table" in pages.pop("plan")
    assert "orthocal plan" not in "".join(pages.values())
    assert "as predicted" in pages["verify sound.csv after.csv --machine mine.yaml"]
    (entry,) = yaml.safe_load((folder / "mine.yaml").read_text(encoding="utf-8"))["history"]
    assert entry["before"] == dict.fromkeys("abc", 10.0)
    assert entry["after"]["b"] == pytest.approx(9.3, abs=0.05)


@pytest.mark.parametrize("path", re.findall(r"`([\w/]+\.(?:py|md)|[a-z]\w*/[\w/]+)`", PAGE))
def test_every_file_that_is_named_exists(path: str) -> None:
    if not re.search("ID|KIND", path):
        name = path if "." in path else f"{path}.py"
        assert (SOURCE / name).is_file() or (ROOT / name).is_file()
