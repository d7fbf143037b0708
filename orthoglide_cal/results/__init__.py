"""What a technician is told: may the offsets be entered, which, how sure, what is left."""

from orthoglide_cal.results.answer import (
    Answer,
    BudgetLine,
    BudgetTotal,
    CheckReading,
    FoundCause,
    Parameter,
    Release,
    Remedy,
    Workspace,
)
from orthoglide_cal.results.application import Application, Recording, apply, recording, take_back
from orthoglide_cal.results.identity import Identity, identify
from orthoglide_cal.results.making import answer_to, budget_lines, remainder
