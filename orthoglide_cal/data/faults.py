"""Collecting everything that is wrong with a file, not only the first thing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

from orthoglide_cal.errors import InputError, InvalidFileError

MOST_FAULTS = 1000  # a file of garbage has millions; nobody reads them


class Faults:
    """The faults of one file, in the order found.

    Args:
        file: path as the user gave it.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self.problems: list[InputError] = []
        self._more = 0

    def __bool__(self) -> bool:
        return bool(self.problems)

    def add(
        self,
        what: str,
        remedy: str,
        *,
        line: int | None = None,
        column: str | None = None,
        value: str | None = None,
    ) -> None:
        """Note one fault at its place."""
        if len(self.problems) >= MOST_FAULTS:
            self._more += 1
            return
        self.problems.append(
            InputError(what, remedy, file=self.file, line=line, column=column, value=value)
        )

    def take(self, error: InputError, *, line: int | None, column: str | None) -> None:
        """Note an error that knows its value but not its place."""
        self.add(error.what, error.remedy, line=line, column=column, value=error.value)

    def check(self, cause: Exception | None = None) -> None:
        """Raise InvalidFileError (from `cause`) with all faults by line, if there are any."""
        if not self.problems:
            return
        problems = sorted(self.problems, key=lambda fault: fault.line or 0)
        if self._more:
            what = f"There are {self._more} more faults like these."
            problems.append(InputError(what, "Mend the first ones and try again.", file=self.file))
        raise InvalidFileError(problems, file=self.file) from cause


def listed(names: Sequence[str]) -> str:
    """Names for a message, with commas; the first ten where there are more."""
    return ", ".join(names[:10]) + (f" and {len(names) - 10} more" if len(names) > 10 else "")


def nearest(name: str, known: Iterable[str]) -> str:
    """The words "Did you mean …?" for the closest known name; empty if none is close."""
    close = get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f"Did you mean {close[0]!r}? " if close else ""
