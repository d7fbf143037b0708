"""Estimation of the joint offsets: one problem, one least squares, covariance, the promise."""

from orthoglide_cal.estimation.least_squares import LeastSquaresFit, Problem, fit_offsets
from orthoglide_cal.estimation.methods import Method, Posed, pose, pose_plan
from orthoglide_cal.estimation.solution import (
    OffsetEstimate,
    PromisedDifference,
    Solution,
    fit_parameters,
    promise,
    solve,
    stays,
)
