"""Estimation of the joint offsets: one problem, one least squares, covariance, the promise."""

from orthoglide_cal.estimation.arms import free_arms
from orthoglide_cal.estimation.methods import (
    LeastSquaresFit,
    Method,
    Problem,
    fit_offsets,
    pose,
    pose_plan,
)
from orthoglide_cal.estimation.solution import (
    OffsetEstimate,
    PromisedDifference,
    Solution,
    exceeds_u,
    fit_parameters,
    promise,
    solve,
)
