"""What a Markdown page holds: code blocks, and commands of the program anywhere in it.

Blocks of kind `sh` are run as they stand; those of kind `console` need a machine, or a person.
"""

import re
import shlex
from collections.abc import Iterator

from tests.cli.program import run


def blocks(page: str, kind: str) -> list[str]:
    """The code blocks of a kind, without their fences."""
    found = re.findall(r"^```(\w*)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    return [text for name, text in found if name == kind]


def commands(block: str) -> Iterator[list[str]]:
    """The arguments of each command of the program in a block; `\\` goes on with a line."""
    for line in block.replace("\\\n", " ").splitlines():
        program, *arguments = shlex.split(line.partition("|")[0])
        if program == "orthocal":
            yield arguments


def mentioned(page: str) -> Iterator[list[str]]:
    """The arguments of each command in the blocks to be typed, and between backticks."""
    typed = [*blocks(page, "sh"), *blocks(page, "console")]
    typed += re.findall(r"`(orthocal [^`]+)`", page)
    for block in typed:
        yield from commands(block)


def run_block(block: str) -> None:
    """Run every line of a block; each has to be a command of the program and do what it says."""
    every = list(commands(block))
    assert len(every) == len(block.replace("\\\n", " ").splitlines())
    for arguments in every:
        shown = run(*arguments)
        # A result that must not be entered is shown all the same.
        refused = arguments[0] == "solve" and "sample_data/session.yaml" in arguments
        refused &= "--machine" not in arguments
        assert shown.exit_code == (4 if refused else 0), shown.stderr
        assert shown.stdout or "--output" in arguments
