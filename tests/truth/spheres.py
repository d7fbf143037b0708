"""Where the tool is when the three carriages stand: Newton's method on the sphere equations."""

import numpy as np

from .plan import Floats


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross product along the first axis of arrays of shape (3, ...)."""
    return np.stack([a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)])


def tool_from_carriages(carriages: Floats, legs: Floats, start: Floats, steps: int = 6) -> Floats:
    """Solve |P - B_i| = L_i for P near `start`, for many moments at once.

    A Newton step solves 2 (P - B_i) . dP = L_i^2 - |P - B_i|^2 by Cramer's rule. From within 5 mm
    the error after n steps is about 300 mm * (5/300)^(2^n); behind a step below 1e-7 mm it is below
    rounding.

    Args:
        carriages: B, shape (3 legs, 3 components, ...), [mm].
        legs: L, shape (3 legs, ...) or (3 legs, 1...), [mm].
        start: first guess of P, shape (3 components, ...), [mm].
        steps: Newton steps at most.

    Returns:
        P, shape (3 components, ...), [mm].
    """
    tool = np.broadcast_to(start, carriages.shape[1:]).copy()
    for _ in range(steps):
        spans = tool[None] - carriages
        excess = ((spans * spans).sum(axis=1) - legs * legs) / 2.0
        normals = [_cross(spans[(i + 1) % 3], spans[(i + 2) % 3]) for i in range(3)]
        volume = (spans[0] * normals[0]).sum(axis=0)
        step = (excess[0] * normals[0] + excess[1] * normals[1] + excess[2] * normals[2]) / volume
        tool -= step
        if np.abs(step).max() < 1e-7:
            break
    return tool
