"""The answers of `diagnose --json`, read as the contract states them."""

import json
from dataclasses import dataclass
from typing import Any

VERDICTS = ("consistent", "named", "ambiguous", "unexplained")


class ContractError(ValueError):
    """An answer does not keep the contract; says which field."""


@dataclass(frozen=True)
class NamedCause:
    """One entry of `causes`."""

    id: str
    probability: float
    aliases: tuple[str, ...]
    heldout_before: float | None
    """[mm]"""
    heldout_after: float | None
    """[mm]"""
    heldout_ratio: float | None = None
    """Held-out errors over what the model states for them; beyond the contract, read if given."""


@dataclass(frozen=True)
class Answer:
    """One line of output."""

    verdict: str
    """One of `VERDICTS`, or `error`."""
    causes: tuple[NamedCause, ...] = ()
    ambiguous_with: tuple[str, ...] = ()
    offsets: tuple[float, ...] = ()
    """x, y, z under the accepted model, [mm]."""
    std: tuple[float, ...] = ()
    """Their standard deviations, [mm]."""
    noise: float | None = None
    """`lack_of_fit.noise_mm`, [mm]."""
    error: str | None = None

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
        """Every cause in the answer: accepted, an alias of one, or ambiguous with it."""
        if self.verdict not in ("named", "ambiguous"):
            return frozenset()
        aliases = (alias for cause in self.causes for alias in cause.aliases)
        return frozenset((*self.ids, *aliases, *self.ambiguous_with))


def _take(entry: dict[str, Any], field: str, where: str) -> Any:
    if field not in entry:
        raise ContractError(f"{where}{field} is missing")
    return entry[field]


def _numbers(entry: dict[str, Any], field: str) -> tuple[float, ...]:
    values = _take(entry, field, "")
    return tuple(float(_take(values, axis, f"{field}.")) for axis in "xyz")


def _optional(value: object) -> float | None:
    return None if value is None else float(str(value))


def parse_answer(line: str) -> Answer:
    """Read one line of `diagnose --json`.

    Raises:
        ContractError: a field is missing or the verdict is unknown.
    """
    entry = json.loads(line)
    if "error" in entry:
        return Answer("error", error=str(entry["error"]))
    verdict = _take(entry, "verdict", "")
    if verdict not in VERDICTS:
        raise ContractError(f"verdict {verdict!r} is not one of {VERDICTS}")
    causes = tuple(
        NamedCause(
            id=_take(cause, "id", f"causes[{n}]."),
            probability=float(_take(cause, "probability", f"causes[{n}].")),
            aliases=tuple(_take(cause, "aliases", f"causes[{n}].")),
            heldout_before=_optional(_take(cause, "heldout_before_mm", f"causes[{n}].")),
            heldout_after=_optional(_take(cause, "heldout_after_mm", f"causes[{n}].")),
            heldout_ratio=_optional(cause.get("heldout_ratio")),
        )
        for n, cause in enumerate(_take(entry, "causes", ""))
    )
    return Answer(
        verdict=verdict,
        causes=causes,
        ambiguous_with=tuple(_take(entry, "ambiguous_with", "")),
        offsets=_numbers(entry, "offsets_mm"),
        std=_numbers(entry, "std_mm"),
        noise=_optional(_take(_take(entry, "lack_of_fit", ""), "noise_mm", "lack_of_fit.")),
    )
