"""Which readings share one unknown gauge zero."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from orthoglide_cal.axes import Ints


def number_setups(
    places: Sequence[Hashable], gauges: Sequence[str], in_time: Sequence[int], *, ordered: bool
) -> Ints:
    """Number the gauge set-ups, 0 … k−1 by first use, shape (n,).

    A gauge that stays in its place keeps its zero. A gauge known by its label that was used
    elsewhere and comes back has been set up anew: its zero is another one. That can only be said
    where the file states the order in time.

    Args:
        places: where each reading's gauge stood (leg, direction, position along the leg).
        gauges: labels; "" where unknown.
        in_time: indices of the readings from first to last.
        ordered: the order in time is stated, not assumed from the order of the rows.
    """
    setup = np.zeros(len(places), dtype=np.intp)
    known: dict[Hashable, int] = {}
    last: dict[str, Hashable] = {}
    count = 0
    for index in in_time:
        place, gauge = places[index], gauges[index]
        key = (place, gauge)
        returned = ordered and gauge and last.get(gauge, place) != place
        if returned or key not in known:
            known[key] = count
            count += 1
        last[gauge] = place
        setup[index] = known[key]
    return setup
