"""What the layouts of a kind of machine are worth, before one is measured.

A kind of machine that measures itself takes no protocol with cycles: it has layouts, ways to spread
its readings. They are compared on equal terms, and the quickest is found that tells apart what
hides behind each other in the usual ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from orthoglide_cal.errors import UsageError
from orthoglide_cal.estimation.accuracy import determined
from orthoglide_cal.estimation.budget import Budget
from orthoglide_cal.model import Cause, Model
from orthoglide_cal.model.layouts import Layout
from orthoglide_cal.planning.expected import Foreseen, expected_budget
from orthoglide_cal.planning.separation import Separations, separations

# Told apart: so far from each other that chance does not count [standard deviations].
TOLD_SIGMA = 5.0


@dataclass(frozen=True, eq=False)
class Laid(Foreseen):
    """What a layout will give.

    Attributes:
        model: the machine, its probe and its accepted causes.
        layout: how it is measured.
        budget: of the calibrated parameters, at the degrees of freedom that the readings will have.
        rivals_sigma: between what hides behind each other [standard deviations]; None where one
            of the two cannot be.
    """

    model: Model
    layout: Layout
    budget: Budget
    rivals_sigma: float | None

    @classmethod
    def of(cls, model: Model, layout: Layout) -> Laid:
        """Before a reading is taken."""
        return cls(model, layout, expected_budget(model, layout.plan), _apart(model, layout))

    @cached_property
    def held(self) -> Budget | None:
        """Of the budget what is taken as the controller has it; None if that is nothing."""
        ids = self.model.machine.fixed_parameters
        parts = tuple(each for each in self.budget.contributions if each.source in ids)
        return Budget(parts) if parts else None

    @cached_property
    def seen(self) -> Budget:
        """The rest of the budget: what the layout can lessen."""
        ids = self.model.machine.fixed_parameters
        return Budget(tuple(each for each in self.budget.contributions if each.source not in ids))

    @cached_property
    def determined(self) -> tuple[bool, ...]:
        """Which parameters are known better than any such machine could be off."""
        return determined(self.model, self.expanded_mm)

    @cached_property
    def separations(self) -> Separations:
        """Which causes its readings can tell apart."""
        return separations(self.model, self.layout.plan)


@dataclass(frozen=True, eq=False)
class LayoutProspect:
    """What layouts will give.

    Attributes:
        model: the machine, its probe and its accepted causes.
        compared: each layout of its kind.
        telling: the quickest that tells the rivals apart, or else the one that tells them best;
            None where there is nothing to tell.
        chosen: the one to be measured.
    """

    model: Model
    compared: tuple[Laid, ...]
    telling: Laid | None
    chosen: Laid

    @property
    def rivals(self) -> tuple[str, str]:
        """Ids of the causes that hide behind each other."""
        first, second = self.model.machine.rivals
        return first, second

    @cached_property
    def tells(self) -> bool:
        """Whether the rivals are told apart by some layout."""
        return self.telling is not None and (self.telling.rivals_sigma or 0.0) >= TOLD_SIGMA

    @property
    def shown(self) -> tuple[Laid, ...]:
        """Every layout, the telling one last."""
        return self.compared if self.telling is None else (*self.compared, self.telling)


def layout_prospect(model: Model, name: str | None = None) -> LayoutProspect:
    """What layouts will give.

    Args:
        model: a machine whose kind has layouts.
        name: of the layout to be measured; the telling one if None, or without one the longest
            that needs nothing but the machine itself.

    Raises:
        UsageError: there is no layout of this name.
    """
    compared = tuple(Laid.of(model, layout) for layout in model.machine.layouts())
    telling = _telling(model)
    every = compared if telling is None else (telling, *compared)
    names = [each.layout.name for each in every]
    if name is None:
        return LayoutProspect(model, compared, telling, every[0])
    if name not in names:
        raise UsageError(f"There is no layout {name!r}.", f"Choose one of {', '.join(names)}.")
    return LayoutProspect(model, compared, telling, every[names.index(name)])


def _telling(model: Model) -> Laid | None:
    """The quickest layout that tells the rivals apart, or the one that tells them best."""
    best, most = None, 0.0
    for layout in model.machine.distinguishing_layouts():
        sigma = _apart(model, layout)
        if sigma is None:
            return None
        if sigma > most:
            best, most = layout, sigma
        if sigma >= TOLD_SIGMA:
            break
    return None if best is None else Laid.of(model, best)


def _apart(model: Model, layout: Layout) -> float | None:
    """How far the rivals are apart; None where one of the two cannot be."""
    pairs: tuple[tuple[Cause, Cause, float], ...]
    pairs = separations(model, layout.plan, model.machine.rivals).pairs
    return pairs[0][2] if pairs else None
