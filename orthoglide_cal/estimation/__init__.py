"""Estimation of the joint offsets: one problem, one least squares, covariance, the promise."""

from orthoglide_cal.estimation.arms import free_arms
from orthoglide_cal.estimation.solution import (
    LeastSquaresFit,
    Method,
    OffsetEstimate,
    Problem,
    PromisedDifference,
    Solution,
    fit_offsets,
    fit_parameters,
    pose,
    pose_plan,
    promise,
    solve,
)
