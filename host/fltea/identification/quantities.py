"""N, B, K and bias of an axis, for the command, for comparisons and for the Python interface."""

from typing import NamedTuple

from fltea.identification.forecast import Now
from fltea.records.fit import Interval, Level
from fltea.records.plus_minus import NORMAL_95
from fltea.records.quantity import Quantity, coefficient_units, quantity_of
from fltea.spectrum.allan_curve import Allan


class Quantities(NamedTuple):
    """N, B, K and the bias of one axis."""

    N: Quantity
    B: Quantity
    K: Quantity
    bias: Quantity


def quantities(unit: str, level: Level, allan: Allan | None, now: Now | None) -> Quantities:
    """Return the figures of an axis. N is in the unit of the samples per √Hz, K in that unit per √s.

    `level`: N and K. `allan`: the Allan deviation, with B. `now`: the bias at the end of the record.
    """
    of, bias = coefficient_units(unit), Interval()
    B = (
        quantity_of(Interval(), of.B)
        if allan is None
        else quantity_of(allan.B.interval, of.B, allan.B.at_most)
    )
    if now is not None:
        half = NORMAL_95 * now.bias_std
        bias = Interval(now.bias, now.bias - half, now.bias + half)
    N, K = quantity_of(level.N, of.N), quantity_of(level.K, of.K, level.K_at_most)
    return Quantities(N, B, K, quantity_of(bias, unit))
