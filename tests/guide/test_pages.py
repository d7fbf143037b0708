"""The pages of the guide: complete, true, and found by `orthocal guide` however one types it."""

import contextlib
import io
import re
from pathlib import Path

import pytest
import yaml

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import InputError
from orthoglide_cal.files.machine_file import default_machine
from orthoglide_cal.report import sentences
from orthoglide_cal.words import unit_words
from tests.cli.program import DOUBLE, done, lines, run
from tests.machines import ROOT
from tests.markdown import blocks, mentioned, run_block

FOLDER = ROOT / "orthoglide_cal" / "guide"
# Without what stands above the title of a cause.
PAGES = {
    path.stem: path.read_text(encoding="utf-8").rpartition("---\n\n")[2]
    for path in sorted(FOLDER.rglob("*.md"))
}
OF_CAUSES = {path.stem for path in (FOLDER / "causes").glob("*.md")}
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_every_cause_has_its_page() -> None:
    assert set(CAUSES) == OF_CAUSES


@pytest.mark.parametrize("id", CAUSES)
def test_the_page_of_a_cause_says_what_the_cause_is(id: str) -> None:
    cause, page = CAUSES[id], PAGES[id]
    assert re.match(rf"# {id}: [a-z].*[^.]\n", page)
    assert blocks(page, "text"), "no picture"
    assert (size := re.search(r"^- \*Usual size\*: (.*)", page, re.MULTILINE))
    assert "**What to do.**" in page
    if cause.names and not cause.counts:
        usual = next(iter(cause.sizes.values()))
        assert size[1].startswith(f"{usual:g} {unit_words(cause.unit)}")
    # Another kind of machine may have another size.
    sizes = {kind.model_fields["kind"].default: usual for kind, usual in cause.sizes.items()}
    for kind, usual in sizes.items():
        if usual != sizes.get("orthoglide", usual):
            said = rf"{usual:g} {re.escape(unit_words(cause.unit))}.*{kind.replace('_', ' ')}"
            assert re.search(said, " ".join(page.split())), f"its size on a {kind}"
    if list(sizes) == ["linear_delta"]:
        assert "Of a linear delta." in page


def test_a_key_of_its_head_that_nobody_reads_is_refused(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(sentences, "files", lambda _: tmp_path)
    (path := tmp_path / "guide" / "causes" / "odd.md").parent.mkdir(parents=True)
    path.write_text("---\ncheck: c\nlinear_dleta:\n  advice: a\n---\n\n# odd: o\n", "utf-8")
    with pytest.raises(InputError, match=r"causes/odd.md, linear_dleta: .*Known: advice, check"):
        sentences.cause_words("odd", default_machine().machine)


def test_every_page_stands_in_a_list() -> None:
    def listed(name: str) -> list[str]:
        return re.findall(r"^- `([\w-]+)`:", PAGES[name], re.MULTILINE)

    assert sorted(listed("causes")) == sorted(OF_CAUSES)
    assert sorted(listed("index")) == sorted(set(PAGES) - OF_CAUSES - {"index"})
    assert set(re.findall(r"`([\w-]+)`", PAGES["index"])) >= set(PAGES) - {"index"}


def test_every_command_is_explained() -> None:
    listed = run("--help").stdout.split("Commands:")[1]
    told = {arguments[0] for page in PAGES.values() for arguments in mentioned(page)}
    commands = {line.split()[0] for line in listed.splitlines() if re.match(r"  \w", line)}
    assert commands
    assert commands <= told | {"guide"}


def test_every_command_exists() -> None:
    """With all its options. `--help` comes first where the first word would act at once."""
    typed = {tuple(words) for page in (*PAGES.values(), README) for words in mentioned(page)}
    for arguments in sorted(typed):
        helped = ("--help", *arguments) if arguments[0].startswith("-") else (*arguments, "--help")
        shown = run(*helped)
        assert shown.exit_code == 0, shown.stderr
        if arguments[0] == "guide":
            assert run(*arguments).exit_code == 0, arguments


def test_it_fits_the_narrowest_terminal_in_use() -> None:
    for name, page in PAGES.items():
        code = [line for kind in ("text", "sh", "console", "python") for block in
                blocks(page, kind) for line in block.splitlines()]  # fmt: skip
        assert max(map(len, code), default=0) <= 78, name
        assert max(map(len, page.splitlines())) <= 80, name
        assert page.count("\n```") == 2 * len(re.findall(r"^```\w+$", page, re.M)), name


EXAMPLES = {name: blocks(page, "sh") for name, page in {**PAGES, "README": README}.items()}


@pytest.mark.parametrize("name", [name for name, found in EXAMPLES.items() if found])
def test_its_examples_run(name: str, beside_the_samples: Path) -> None:
    for block in EXAMPLES[name]:
        run_block(block)


def test_the_shown_files_are_files(tmp_path: Path) -> None:
    readings, differences = (tmp_path / name for name in ("readings.csv", "differences.csv"))
    for path, block in zip((readings, differences), blocks(PAGES["files"], "text"), strict=True):
        path.write_text(block, encoding="utf-8")
    checked = run("validate", str(readings))
    # Nothing is wrong with them but that they are the beginning of a session.
    assert checked.exit_code == 4
    assert "3 readings, which give no offsets" in checked.stdout
    assert run("validate", str(differences)).exit_code == 0


def test_the_budget_is_the_one_that_solve_prints(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "78")
    shown = blocks(PAGES["uncertainty"], "text")[1]
    assert shown.startswith("Uncertainty of the offsets")
    assert shown.strip() in run("solve", DOUBLE, "--details").stdout


def test_the_plan_is_the_one_that_is_printed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "78")
    printed = run("plan", "--details").stdout
    for block in blocks(PAGES["plan"], "text"):
        assert block.strip() in printed


def test_what_the_page_puts_into_the_machine_file_is_assumed_no_more(tmp_path: Path) -> None:
    stated = yaml.safe_load(blocks(PAGES["uncertainty"], "text")[2])
    path = tmp_path / "machine.yaml"
    shipped = yaml.safe_load((ROOT / "configs" / "orthoglide_prototype.yaml").read_text("utf-8"))

    def assumed() -> set[str]:
        path.write_text(yaml.safe_dump(shipped), encoding="utf-8")
        (found,) = lines(run("solve", DOUBLE, "--machine", str(path), "--json"))
        return {each["source"] for each in found["budget"] if each["assumed"]}

    del shipped["tolerances"]
    before = assumed()
    shipped.update(stated)
    assert before - assumed() == {"gauge_scale", "gauge_placement", "leg_length"}


def test_the_python_example_runs(beside_the_samples: Path) -> None:
    (code,) = blocks(PAGES["developing"], "python")
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(code, "developing.md", "exec"), {})
    assert "residuals_agree" in printed.getvalue()


def on_screen(monkeypatch: pytest.MonkeyPatch, columns: int, *topic: str) -> str:
    """What a terminal of this width shows, without colours."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", str(columns))
    return re.sub(r"\x1b\[[0-9;]*m", "", done("guide", *topic))


def test_every_topic_is_laid_out_on_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, page in PAGES.items():
        shown = on_screen(monkeypatch, 80, name)
        assert max(map(len, shown.splitlines())) <= 80, name
        assert not re.search(r"\*\*|```", shown), name
        lines = [line.strip() for line in shown.splitlines()]
        code = [block for kind in ("text", "sh", "console") for block in blocks(page, kind)]
        broken = {line.strip() for block in code for line in block.splitlines()}.difference(lines)
        assert not broken, name


def test_a_wide_screen_is_not_used_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    def widest(columns: int) -> int:
        shown = on_screen(monkeypatch, columns, "signs")
        return max(len(line.rstrip()) for line in shown.splitlines())

    assert widest(60) <= 60 < 80 < widest(100) == widest(250) <= 100


@pytest.mark.parametrize(
    ("typed", "name"),
    [
        ((), "index"),
        (("What", "to", "do", "when"), "what-to-do-when"),
        (("what-to-do when",), "what-to-do-when"),
        (("AXIS-GAP",), "axis_gap"),
        (("axis gap",), "axis_gap"),
    ],
)
def test_a_topic_however_it_is_written(typed: tuple[str, ...], name: str) -> None:
    assert run("guide", *typed).stdout == PAGES[name]
