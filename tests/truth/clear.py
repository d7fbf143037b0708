"""Effects outside the list that no listed cause, and no pair of them, comes near."""

from .machines import Gauge, Machine
from .separation import pair_distances, separation
from .session import Session, make_session


def clear_outside(
    seed: int,
    machine: Machine,
    gauge: Gauge,
    outside: str,
    single: float = 10.0,
    pair: float = 8.0,
    tries: int = 60,
) -> Session:
    """Redraw, each time 10 % larger, until the effect stands clear of everything listed.

    Args:
        single: least distance from every single cause and from healthy [sigma].
        pair: least distance from every pair of a measurement and a machine cause [sigma]. At 8
            the best pair leaves a chi-square 64 too large, over 6 standard deviations of it.
        tries: after so many the draw is given up.

    Raises:
        RuntimeError: the effect cannot be made clear.
    """
    for attempt in range(tries):
        session = make_session(
            seed * tries + attempt,
            machine,
            gauge,
            outside=outside,
            scale=1.1 ** min(attempt, 20),
        )
        if separation(session).distance < single:
            continue
        if next(iter(pair_distances(session).values())) >= pair:
            return session
    raise RuntimeError(f"{outside} does not stand out on {machine.name} with the {gauge.name}")
