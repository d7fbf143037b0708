"""The answers of `diagnose --json`, read as the contract states them."""

import json
from dataclasses import dataclass

VERDICTS = ("consistent", "named", "ambiguous", "unexplained")
HELD_OUT = ("heldout_before_mm", "heldout_after_mm", "heldout_ratio")


class ContractError(ValueError):
    """An answer does not keep the contract; says which field."""


@dataclass(frozen=True)
class NamedCause:
    """One entry of `causes`."""

    id: str
    aliases: tuple[str, ...] = ()
    heldout_before: float | None = None
    """[mm]"""
    heldout_after: float | None = None
    """[mm]"""
    heldout_ratio: float | None = None
    """Held-out errors over what the model states for them."""


@dataclass(frozen=True)
class Answer:
    """One line of output."""

    verdict: str
    """One of `VERDICTS`, or `error`."""
    causes: tuple[NamedCause, ...] = ()
    ambiguous_with: tuple[str, ...] = ()
    found: tuple[float, ...] = ()
    """Each parameter under the accepted model, [mm, deg]."""
    std: tuple[float, ...] = ()
    """Their standard deviations, [mm, deg]."""
    error: str | None = None
    beyond: tuple[str, ...] = ()
    """Causes that would explain everything far beyond their size."""

    @property
    def ids(self) -> tuple[str, ...]:
        """Causes that the answer accepts, best first."""
        return tuple(cause.id for cause in self.causes)

    @property
    def first(self) -> str:
        """The best cause, or the verdict where none is named."""
        if self.verdict in ("named", "ambiguous") and self.causes:
            return self.causes[0].id
        return self.verdict

    @property
    def mentioned(self) -> frozenset[str]:
        """Every cause in the answer: accepted, an alias of one, ambiguous with it, or beyond."""
        if self.verdict not in ("named", "ambiguous"):
            return frozenset(self.beyond)
        aliases = (alias for cause in self.causes for alias in cause.aliases)
        return frozenset((*self.ids, *aliases, *self.ambiguous_with))


def parse_answer(line: str) -> Answer:
    """Read one line of `diagnose --json`.

    Raises:
        ContractError: a field is missing or the verdict is unknown.
    """
    entry = json.loads(line)
    if "error" in entry:
        return Answer("error", error=str(entry["error"]))
    try:
        if entry["verdict"] not in VERDICTS:
            raise ContractError(f"verdict {entry['verdict']!r} is not one of {VERDICTS}")
        return Answer(
            verdict=entry["verdict"],
            causes=tuple(
                NamedCause(each["id"], tuple(each["aliases"]), *(each[key] for key in HELD_OUT))
                for each in entry["causes"]
            ),
            ambiguous_with=tuple(entry["ambiguous_with"]),
            found=tuple(each["found"] for each in entry["parameters"]),
            std=tuple(each["std"] for each in entry["parameters"]),
            beyond=tuple(each["id"] for each in entry["beyond_tolerance"]),
        )
    except KeyError as missing:
        raise ContractError(f"{missing} is missing") from missing
