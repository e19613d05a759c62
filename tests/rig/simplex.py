"""Nelder & Mead's simplex method on many starts at once (*The Computer Journal* 7(4), 1965).

A fit of a spectrum needs a hundred steps of microseconds each from several starts, for hundreds of series,
and along a profile: one call for all of them spends its time in numpy's loops and not between them. That is
why it is not scipy's, which takes one start a call (and would be one more package on a Raspberry Pi).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
Objective = Callable[[Array, Rows], Array]
"""Of points (k, p) and the number of the start that each belongs to, (k,), to finite values (k,)."""


def minimise(
    objective: Objective, starts: Array, size: float = 0.5, tolerance: float = 1e-3, steps: int = 150
) -> tuple[Array, Array]:
    """Return the best points (starts, p) and their values (starts,).

    size: edge of the first simplices, the same in all coordinates. A start is done when the values of its
    simplex differ by less than `tolerance`, or after `steps` steps.
    """
    m, p = starts.shape
    points = np.repeat(starts[:, np.newaxis], p + 1, axis=1)
    points[:, 1:] += size * np.eye(p)
    rows = np.repeat(np.arange(m), p + 1)
    values = objective(points.reshape(-1, p), rows).reshape(m, p + 1)
    active = np.arange(m)
    for _ in range(steps):
        order = np.argsort(values[active], axis=1)
        best, worst = values[active, order[:, 0]], values[active, order[:, -1]]
        going = worst - best > tolerance
        active, order = active[going], order[going]
        if not active.size:
            break
        _step(objective, points, values, active, order)
    first = values.argmin(axis=1)
    return points[np.arange(m), first], values[np.arange(m), first]


def _step(objective: Objective, points: Array, values: Array, active: Rows, order: Rows) -> None:
    """One step of the simplices `active`, whose corners `order` sorts; changes points and values."""
    p = points.shape[2]
    mine = np.arange(len(active))
    worst = order[:, -1]
    corner = points[active, worst]
    centre = (points[active].sum(axis=1) - corner) / p
    away = centre - corner
    # Reflection, expansion and both contractions at once: fewer calls are faster than fewer points.
    tried = centre[:, np.newaxis] + np.array([1.0, 2.0, 0.5, -0.5])[:, np.newaxis] * away[:, np.newaxis]
    found = objective(tried.reshape(-1, p), np.repeat(active, 4)).reshape(-1, 4)
    reflected = found[:, 0]
    lowest, second, highest = (values[active, order[:, i]] for i in (0, -2, -1))
    choice = np.where(
        reflected < lowest,
        np.where(found[:, 1] < reflected, 1, 0),
        np.where(reflected < second, 0, np.where(reflected < highest, 2, 3)),
    )
    value = found[mine, choice]
    good = np.where(choice == 2, value <= reflected, (choice < 2) | (value < highest))
    points[active[good], worst[good]] = tried[mine[good], choice[good]]
    values[active[good], worst[good]] = value[good]
    shrink = active[~good]
    if shrink.size:
        anchor = points[shrink, order[~good, 0]][:, np.newaxis]
        points[shrink] = anchor + 0.5 * (points[shrink] - anchor)
        values[shrink] = objective(points[shrink].reshape(-1, p), np.repeat(shrink, p + 1)).reshape(-1, p + 1)
