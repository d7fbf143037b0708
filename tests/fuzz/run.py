"""Damaged files and options through the whole program, in this process.

What counts as a failure: an exception that is not one of the program's own, an exit code that is
not documented, more than `PATIENCE_S`, no word about what is wrong, or an answer that no machine of
this size can give.
"""

import contextlib
import io
import json
import signal
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import numpy as np
from typer.main import get_command
from typer.testing import CliRunner

from orthoglide_cal.cli.app import app
from orthoglide_cal.errors import OrthocalError
from orthoglide_cal.session.dialogue import Quit
from orthoglide_cal.session.opening import Request, open_session
from tests.files.test_machine_file import HISTORY, VALUES, accepted, text_with
from tests.firmware_files import CONFIGURATION, FILES
from tests.session.virtual import Screen, Script, answered

from .mutate import HOSTILE, Rng, mutant

# Made once: making the commands takes longer than running one.
COMMAND = get_command(app)
CODES = {0, 2, 3, 4, 130}
WITH_MACHINE = (
    "solve six.csv --machine {}", "diagnose six.csv --machine {} --json", "plan --machine {}",
    "machine show {}", "machine show {} --json", "report six.csv --machine {} --html -",
    "simulate --seed 1 --cycles 1 --machine {}", "apply six.csv --machine {}",
    "apply --undo --machine {}", "export six.csv --machine {} --format table --points 2",
)  # fmt: skip
# Nobody finds a carriage this far from where it seems to be [mm].
PLAUSIBLE_MM = 100.0
PATIENCE_S = 20

DIFFERENCES = (
    "difference,value_mm\ndx_y,-0.43\ndx_z,-0.37\ndy_x,0.42\ndy_z,-0.18\ndz_x,-1.14\ndz_y,-0.7\n"
)
OPTIONS = (
    "simulate --seed 1 --cycles {}", "simulate --seed {}", "solve {}", "validate {}", "{}",
    "solve six.csv --method {}", "machine show {}", "apply six.csv --yes --machine {}",
    *(f"simulate --seed 1 --cycles 1 {words}" for words in (
        "--offsets {} {} {}", "--noise {} --resolution {}", "--gauge-at {}", "--cause {}",
        "--cause axis_gap={},{},{}", "--cause misread@{}={}",
    )),
    "verify six.csv six.csv --applied {} {} {} --json",
    "verify six.csv six.csv --applied 1 0 0 --limit {} --json",
    "machine new --yes -o no/m.yaml --leg-length {} --range {}",
    "machine new --yes -o no/m.yaml --limits {} {} --name {}",
)  # fmt: skip
# Commands that read measurements; {} is the damaged file.
READERS = (
    "solve {}", "solve {} --json", "validate {} --json", "validate {}", "diagnose {} --details",
    "diagnose {} --json", "plan {}", "plan {} --json", "export {}", "export {} --force --json",
    "report {} --html -", "report {} --json", "verify {} six.csv --json", "verify six.csv {}",
    "history {} six.csv", "history {} six.csv --json", "diagnose six.csv --holdout {}",
    "apply {} --machine own.yaml", "apply {} --machine own.yaml --json",
)  # fmt: skip


@dataclass(frozen=True)
class Failure:
    """A mutant on which the program failed."""

    kind: str
    """What was damaged."""
    number: int
    """Of the mutant; with the seed of the run it is the same again."""
    what: str
    text: str


class Fuzz:
    """Mutants of one of each kind of file, or of those of firmwares, in an empty folder."""

    def __init__(self, folder: Path, seed: int, firmwares: bool = False) -> None:
        self.folder, self.seed = folder, seed
        if firmwares:
            self._kinds = tuple(self._of_firmwares())
            return
        run = CliRunner().invoke
        with contextlib.chdir(folder):
            Path("six.csv").write_text(DIFFERENCES, encoding="utf-8")
            run(app, ["simulate", "--seed", "1", "--cycles", "1", "--output", "good.csv"])
            run(app, ["simulate", "--seed", "1", "--cycles", "1", "--output", "good.yaml"])
            run(app, ["machine", "new", "--yes", "-o", "own.yaml"])
            answered(Path("good.journal"), ["-0.64", "0.41", "u", "0.42", "n a note", "s hidden"])
        texts = {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}
        machine = text_with(*map(accepted, VALUES)).replace("\nhistory: []", HISTORY.rstrip())
        table, session, journal = (texts[f"good.{end}"] for end in ("csv", "yaml", "journal"))
        self._kinds: tuple[tuple[str, Callable[[str], str | None], str], ...] = (
            *(("table", self._file("m.csv", READERS), table),) * 2,
            ("differences", self._file("m.csv", READERS), DIFFERENCES),
            *(("session", self._file("m.yaml", READERS), session),) * 2,
            *(("machine", self._file("m.yaml", WITH_MACHINE), machine),) * 2,
            ("journal", self._journal, journal),
            # Damage that the checksums hide, as of a journal that another version wrote.
            ("records", lambda text: self._journal(signed(text)), records(journal)),
            ("options", lambda text: self._judge(json.loads(text)), ""),
        )

    def _of_firmwares(self) -> Iterator[tuple[str, Callable[[str], str | None], str]]:
        """Each file is judged with whole settings in its folder, and these with whole heights."""
        map_, settings = FILES["heightmap.csv"], FILES["config.g"]
        (self.folder / "six.csv").write_text(DIFFERENCES, encoding="utf-8")
        for folder in ("whole", "damaged"):
            (self.folder / folder).mkdir()
        (self.folder / "whole" / "config.g").write_text(settings, encoding="utf-8")
        (self.folder / "whole" / "printer.cfg").write_text(CONFIGURATION, encoding="utf-8")
        (self.folder / "damaged" / "heightmap.csv").write_text(map_, encoding="utf-8")
        for name, text in FILES.items():
            # Reading is what is damaged; judging takes longer.
            commands = ("validate {} --json",) * 4 + READERS
            damaged = f"whole/m-{name}"
            if name == "config.g":
                damaged = "damaged/config.g"
                commands = tuple(
                    f"{word} damaged/heightmap.csv --machine {{}}"
                    for word in ("validate", "validate", "solve", "diagnose", "plan", "export")
                )
            yield name, self._file(damaged, commands), text

    def run(self, count: int) -> Iterator[Failure]:
        """The failures among that many mutants."""
        before = signal.signal(signal.SIGALRM, _late)
        try:
            with contextlib.chdir(self.folder):
                for number in range(count):
                    rng = np.random.default_rng([self.seed, number])
                    kind, judge, whole = self._kinds[number % len(self._kinds)]
                    text = mutant(whole, rng) if whole else _options(rng)
                    if wrong := judge(text):
                        yield Failure(kind, number, wrong, text)
        finally:
            signal.signal(signal.SIGALRM, before)

    def _file(self, name: str, commands: Sequence[str]) -> Callable[[str], str | None]:
        """Judge of texts of that file: each text goes through one of the commands."""

        def judge(text: str) -> str | None:
            content = text.encode("utf-8", "surrogatepass")
            Path(name).write_bytes(content)
            words = commands[zlib.crc32(content) % len(commands)]
            wrong = self._judge(words.replace("{}", name).split())
            return wrong and f"{words}: {wrong}"

        return judge

    def _journal(self, text: str) -> str | None:
        """An unfinished session that is gone on with; it asks until nobody answers any more."""
        for path in Path().glob("m.*"):
            path.unlink()
        Path("m.journal").write_bytes(text.encode("utf-8", "surrogatepass"))
        request, screen = Request(Path("m.yaml"), resume=True), Screen()
        signal.alarm(PATIENCE_S)
        try:
            session = open_session(request, Path(), Script(["0.1", "k", "q"]), screen)
            with contextlib.closing(session) as dialogue:
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

    def _judge(self, arguments: list[str]) -> str | None:
        """What is wrong with how the program took it; None if nothing is."""
        out, said, code = io.StringIO(), io.StringIO(), 0
        sys.stdin = io.TextIOWrapper(io.BytesIO())
        signal.alarm(PATIENCE_S)
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
                COMMAND(arguments, prog_name="orthocal")
        except SystemExit as end:
            code = int(end.code or 0)
        except Exception as error:
            return repr(error)
        finally:
            signal.alarm(0)
            sys.stdin = sys.__stdin__
        if code not in CODES:
            return f"exit code {code}"
        if code and not (out.getvalue() + said.getvalue()).strip():
            return "not a word"
        if code == 0 and arguments[0] == "solve" and "--json" in arguments:
            found = [each["found"] for each in json.loads(out.getvalue())["parameters"]]
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
    chosen = OPTIONS[int(rng.integers(len(OPTIONS)))].split()
    return json.dumps([part.replace("{}", str(rng.choice(HOSTILE))) for part in chosen])


def _late(number: int, frame: FrameType | None) -> None:
    raise TimeoutError(f"more than {PATIENCE_S} s")
