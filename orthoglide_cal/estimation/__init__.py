"""Estimation of the joint offsets: linear, nonlinear, all readings; accuracy; Monte Carlo."""

from orthoglide_cal.estimation.batch import Batch, solve_many
from orthoglide_cal.estimation.methods import METHODS, usable_methods
from orthoglide_cal.estimation.nonlinear import Fit, fit_offsets
from orthoglide_cal.estimation.problem import Problem
from orthoglide_cal.estimation.solution import Solution, TableRow
from orthoglide_cal.estimation.solve import solve

__all__ = [
    "METHODS",
    "Batch",
    "Fit",
    "Problem",
    "Solution",
    "TableRow",
    "fit_offsets",
    "solve",
    "solve_many",
    "usable_methods",
]
