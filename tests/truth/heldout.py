"""What an honest model must expect of its own held-out errors."""

import numpy as np

from .forward import MACHINE_CAUSES
from .linear import neighbourhood
from .plan import CYCLE
from .session import Session


def expected_heldout(session: Session) -> float:
    """r.m.s. error expected when each cell is predicted from all the others [mm].

    A cell is all readings of one (leg, direction, posture). The model is the session's true one:
    zeros and offsets free, the hidden machine causes with their tolerances. Each held-out reading
    has the variance sigma^2 (1 + x C x') from noise and parameter uncertainty.
    """
    near = neighbourhood(session.machine, session.gauge, session.plan, session.offsets)
    hidden = [near.families[c] for c in session.causes if c in MACHINE_CAUSES]
    patterns = np.concatenate((near.free, *hidden), axis=1)
    penalty = np.diag([0.0] * near.free.shape[1] + [1.0] * (patterns.shape[1] - 9))
    postures = np.array([CYCLE.index(name) for name in session.plan.posture])
    cells = session.plan.setup * len(CYCLE) + postures
    variance = np.ones(session.plan.count)
    for cell in np.unique(cells):
        out = cells == cell
        kept = patterns[~out]
        spread = np.linalg.inv(kept.T @ kept + penalty)
        variance[out] += np.einsum("ni,ij,nj->n", patterns[out], spread, patterns[out])
    return float(session.gauge.sigma * np.sqrt(variance.mean()))
