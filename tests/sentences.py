"""Reasons of an answer as people read them."""

from collections.abc import Iterable

from orthoglide_cal.model.machine import Machine
from orthoglide_cal.report.sentences import sentence
from orthoglide_cal.schema import Reason
from tests.machines import PROTOTYPE


def sentences(reasons: Iterable[Reason], machine: Machine = PROTOTYPE) -> list[str]:
    """In the words of a kind of machine."""
    return [sentence(reason, machine) for reason in reasons]
