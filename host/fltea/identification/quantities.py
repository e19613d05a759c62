"""Return N, B, K and bias of an axis, shared by the command, its comparison and Python."""

from typing import NamedTuple

from fltea.identification.forecast import Now
from fltea.records.fit import Level
from fltea.records.plus_minus import NORMAL_95
from fltea.records.quantity import Quantity
from fltea.spectrum.allan_curve import Allan


class Quantities(NamedTuple):
    """The figures of one axis."""

    N: Quantity
    B: Quantity
    K: Quantity
    bias: Quantity


def quantities(unit: str, level: Level, allan: Allan | None, now: Now | None) -> Quantities:
    """Return the figures in the unit of the samples: N per √Hz, K per √s.

    `level`: has N and K. `allan`: the curve that has B. `now`: has the bias at the end of the record.
    """
    B = Quantity(None, None, None, None, unit)
    if allan is not None:
        B = Quantity(allan.B.value, allan.B.low, allan.B.high, allan.B.at_most, unit)
    bias = Quantity(None, None, None, None, unit)
    if now is not None:
        half = NORMAL_95 * now.bias_std
        bias = Quantity(now.bias, now.bias - half, now.bias + half, None, unit)
    N, K = level.N, level.K
    return Quantities(
        Quantity(N.value, N.low, N.high, None, f"{unit}/√Hz"),
        B,
        Quantity(K.value, K.low, K.high, level.K_at_most, f"{unit}/√s"),
        bias,
    )
