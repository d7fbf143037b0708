"""Damaged files and options through the whole program, in this process.

What counts as a failure: an exception that is not one of the program's own, an exit code that is
not documented, more than `PATIENCE_S`, no word about what is wrong, or an answer that no machine of
this size can give.
"""

import contextlib
import json
import re
import signal
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType

import numpy as np
import yaml

from orthoglide_cal.errors import OrthocalError
from orthoglide_cal.session.asking import Asker
from orthoglide_cal.session.dialogue import Quit, Request, open_session
from tests import conftest  # noqa: F401  # options are made once, which takes longer than a command
from tests.cli.program import done, lines, run
from tests.files.test_machine_file import HISTORY, VALUES, accepted, text_with
from tests.firmware_files import CONFIGURATION, FILES
from tests.session.virtual import Screen, Script, answered

DAMAGE = yaml.safe_load(Path(__file__).with_name("damage.yaml").read_text(encoding="utf-8"))
HOSTILE = (*DAMAGE["hostile"], "9" * 400)
READERS = DAMAGE["readers"]
# Numbers more often than words and lines, and these more often than pieces of any length.
PARTS = (*(r"[-+]?\d+(?:\.\d+)?",) * 3, *(r"\w+",) * 2, *(r".*\n",) * 2, *(r"(?s).{%d}",) * 2)
CODES = {0, 2, 3, 4, 130}
# Nobody finds a carriage this far from where it seems to be [mm].
PLAUSIBLE_MM = 100.0
PATIENCE_S = 20

DIFFERENCES = (
    "difference,value_mm\ndx_y,-0.43\ndx_z,-0.37\ndy_x,0.42\ndy_z,-0.18\ndz_x,-1.14\ndz_y,-0.7\n"
)
Rng = np.random.Generator
# What is wrong with how the program took a text; None if nothing is.
Judge = Callable[[str], str | None]


def hostile(rng: Rng) -> str:
    return HOSTILE[int(rng.integers(len(HOSTILE)))]


def mutant(text: str, rng: Rng) -> str:
    """The text with one to four damages, each of a number, a word, a line or another piece."""
    for _ in range(int(rng.integers(1, 5))):
        part = PARTS[int(rng.integers(len(PARTS)))].replace("%d", str(rng.integers(1, 40)))
        spans = [found.span() for found in re.finditer(part, text)] or [(len(text), len(text))]
        (a, b), (c, d) = sorted(spans[int(k)] for k in rng.integers(0, len(spans), 2))
        number = f"{rng.normal(scale=100.0):.4g}"
        odd = hostile(rng) if rng.random() < 0.6 else number
        changed = (
            text[:a] + text[b:],  # lost
            text[:b] + text[a:],  # twice
            text[:a] + text[c:d] + text[b:],  # another one in its place
            text[:a] + text[c:d] + text[b:c] + text[a:b] + text[d:],  # two changed places
            text[:a],  # cut off
            text[:a] + odd + text[a:],
            *(text[:a] + odd + text[b:],) * 3,
        )
        text = changed[int(rng.integers(len(changed)))]
    return text


class Fuzz:
    """Mutants of one of each kind of file, or of those of firmwares, in an empty folder."""

    def __init__(self, folder: Path, seed: int, firmwares: bool = False) -> None:
        self.folder, self.seed = folder, seed
        with contextlib.chdir(folder):
            Path("six.csv").write_text(DIFFERENCES, encoding="utf-8")
            self.kinds = tuple(self._of_firmwares() if firmwares else self._own())

    def _own(self) -> Iterator[tuple[str, Judge, str]]:
        for name in ("good.csv", "good.yaml"):
            done("simulate", "--seed", "1", "--cycles", "1", "--output", name)
        done("machine", "new", "--yes", "-o", "own.yaml")
        answered(Path("good.journal"), ["-0.64", "0.41", "u", "0.42", "n a note", "s hidden"])
        machine = text_with(*map(accepted, VALUES)).replace("\nhistory: []", HISTORY.rstrip())
        table, session, journal = (
            Path(f"good.{end}").read_text(encoding="utf-8") for end in ("csv", "yaml", "journal")
        )
        yield from [("table", through("m.csv", READERS), table)] * 2
        yield "differences", through("m.csv", READERS), DIFFERENCES
        yield from [("session", through("m.yaml", READERS), session)] * 2
        yield from [("machine", through("m.yaml", DAMAGE["machines"]), machine)] * 2
        yield "journal", gone_on_with, journal
        # Damage that the checksums hide, as of a journal that another version wrote.
        assert signed(records(journal)) == journal
        yield "records", lambda text: gone_on_with(signed(text)), records(journal)
        yield "options", lambda text: judged(json.loads(text)), ""

    def _of_firmwares(self) -> Iterator[tuple[str, Judge, str]]:
        """Each file is judged with whole settings in its folder, and these with whole heights."""
        for folder in ("whole", "damaged"):
            Path(folder).mkdir()
        Path("whole/config.g").write_text(FILES["config.g"], encoding="utf-8")
        Path("whole/printer.cfg").write_text(CONFIGURATION, encoding="utf-8")
        Path("damaged/heightmap.csv").write_text(FILES["heightmap.csv"], encoding="utf-8")
        # Planning takes seconds: the settings of consoles and logs, damaged too, go through it.
        settings = tuple(
            f"{word} damaged/heightmap.csv --machine {{}}"
            for word in ("validate", "validate", "solve", "diagnose", "export")
        )
        # Reading is what is damaged; judging takes longer.
        reading = ("validate {} --json",) * 4 + tuple(READERS)
        for name, text in FILES.items():
            whole = f"whole/m-{name}"
            given = ("damaged/config.g", settings) if name == "config.g" else (whole, reading)
            yield name, through(*given), text

    def run(self, count: int) -> Iterator[str]:
        """What is wrong with how the program took each of that many mutants, and its text."""
        before = signal.signal(signal.SIGALRM, _late)
        try:
            with contextlib.chdir(self.folder):
                for number in range(count):
                    rng = np.random.default_rng([self.seed, number])
                    kind, judge, whole = self.kinds[number % len(self.kinds)]
                    text = mutant(whole, rng) if whole else _options(rng)
                    if wrong := judge(text):
                        yield f"{number} {kind}: {wrong}\n{text}\n"
        finally:
            signal.signal(signal.SIGALRM, before)


def through(name: str, commands: Sequence[str]) -> Judge:
    """Judge of texts of that file: each text goes through one of the commands."""

    def judge(text: str) -> str | None:
        content = text.encode("utf-8", "surrogatepass")
        Path(name).write_bytes(content)
        words = commands[zlib.crc32(content) % len(commands)]
        wrong = judged(words.replace("{}", name).split())
        return wrong and f"{words}: {wrong}"

    return judge


def gone_on_with(text: str) -> str | None:
    """Judge of the journal of an unfinished session, which asks until nobody answers any more."""
    for path in Path().glob("m.*"):
        path.unlink()
    Path("m.journal").write_bytes(text.encode("utf-8", "surrogatepass"))
    request, screen = Request(Path("m.yaml"), resume=True), Screen()
    signal.alarm(PATIENCE_S)
    try:
        with contextlib.ExitStack() as opened:
            dialogue = open_session(request, Asker(Script(["0.1", "k", "q"]), screen), opened)
            dialogue.greet()
            dialogue.run()
            dialogue.publish()
    except (OrthocalError, Quit, EOFError):
        return None
    except Exception as error:
        return repr(error)
    finally:
        signal.alarm(0)
    return None


def judged(arguments: list[str]) -> str | None:
    """What is wrong with how the program took these arguments."""
    signal.alarm(PATIENCE_S)
    shown = run(*arguments)
    signal.alarm(0)
    if shown.exit_code not in CODES:
        return f"exit code {shown.exit_code}, {shown.exception!r}"
    if shown.exit_code and not shown.output.strip():
        return "not a word"
    if shown.exit_code == 0 and arguments[0] == "solve" and "--json" in arguments:
        found = [parameter["found"] for parameter in lines(shown)[0]["parameters"]]
        if not max(map(abs, found)) <= PLAUSIBLE_MM:
            return f"offsets {found}"
    return None


def records(journal: str) -> str:
    """What the lines of a journal record, without their checksums."""
    bodies = (line.partition(',"record":')[2][:-1] for line in journal.splitlines())
    return "\n".join(bodies)


def signed(bodies: str) -> str:
    """A journal of such records, each with the checksum of all up to it."""
    lines, checksum = [], 0
    for body in bodies.split("\n"):
        checksum = zlib.crc32(body.encode("utf-8", "surrogatepass"), checksum)
        lines.append(f'{{"crc32":"{checksum:08x}","record":{body}}}\n')
    return "".join(lines)


def _options(rng: Rng) -> str:
    """A command with hostile values, as JSON."""
    chosen = DAMAGE["options"][int(rng.integers(len(DAMAGE["options"])))].split()
    return json.dumps([part.replace("{}", hostile(rng)) for part in chosen])


def _late(number: int, frame: FrameType | None) -> None:
    raise TimeoutError(f"more than {PATIENCE_S} s")
