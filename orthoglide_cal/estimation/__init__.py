"""Estimation of the joint offsets: one problem, one least squares, covariance, the promise."""
