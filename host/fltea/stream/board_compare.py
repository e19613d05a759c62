"""Make records of a board's estimate of an axis, some with the difference from this computer's estimate."""

import math

import msgspec

from fltea.records.estimate import AxisEstimate, DeviceAxisEstimate, FlteaEstimate, WhyNot
from fltea.records.events import DeviceAxis
from fltea.stream.live import AcceptedFit


def estimate_of(e: DeviceAxis, fit: AcceptedFit, known: AxisEstimate) -> AxisEstimate:
    """Return the record of an axis's estimate, in which α, f and the like come from the board's filter."""
    valid, numbers = _numbers(e)
    of_board = FlteaEstimate(*numbers, valid, e.tuned)
    return msgspec.structs.replace(known, null_p=fit.null_p, whiteness=fit.whiteness, fltea=of_board)


def compare(
    e: DeviceAxis, known: AxisEstimate | None, host_age: int | None, same_settings: bool
) -> DeviceAxisEstimate:
    """Return the board's estimate, with its difference from the host's or the reason why there is none.

    `known`: the host's estimate after the same sample. `host_age`: how many estimates the host's filters have
    made from their start-up window to this sample; None if the host makes no estimates of this axis.
    `same_settings`: whether the host's filters use the settings that the board states.
    """
    valid, numbers = _numbers(e)
    host = None if known is None or host_age is None else known.fltea
    why_not: WhyNot | None = None
    alpha = f = state = None
    # if several reasons apply, the first one in the order of `records.why_not.WHY_NOT` is given
    if not valid:
        why_not = "device_not_valid"
    elif host is None:
        why_not = "other_start"
    elif not host.valid or host.alpha is None or host.f is None or host.state is None:
        why_not = "host_not_valid"
    elif host_age != e.age:
        why_not = "other_start"
    elif e.skipped:
        why_not = "device_skipped"
    elif e.tuned or not same_settings:
        why_not = "other_settings"
    else:
        alpha, f, state = map(finite, (e.alpha - host.alpha, e.f - host.f, e.state_dps - host.state))
    bias, bias_std, of_state, of_state_std = map(finite, e.tracker or (math.nan,) * 4)
    return DeviceAxisEstimate(
        fltea=FlteaEstimate(*numbers, valid, e.tuned),
        age=e.age,
        tracker_bias=bias,
        tracker_bias_std=bias_std,
        tracker_state=of_state,
        tracker_state_std=of_state_std,
        tracker_bias_difference=None
        if bias is None or known is None or known.bias is None
        else bias - known.bias,
        alpha_difference=alpha,
        f_difference=f,
        state_difference=state,
        why_not=why_not,
    )


_Six = tuple[float | None, float | None, float | None, float | None, float | None, float | None]


def _numbers(e: DeviceAxis) -> tuple[bool, _Six]:
    """Return whether the board's estimate is valid, and its six numbers.

    The numbers are α, its standard deviation, f, its standard deviation, the state, and the innovation. All
    six are None if the estimate is not valid. In a valid estimate, the innovation alone may be None: if the
    board had no sample, or if the innovation is not finite.
    """
    if not (e.valid and all(map(math.isfinite, (e.alpha, e.alpha_std, e.f, e.f_std, e.state_dps)))):
        return False, (None, None, None, None, None, None)
    innovation = None if e.missing else finite(e.innovation_dps)
    return True, (e.alpha, e.alpha_std, e.f, e.f_std, e.state_dps, innovation)


def finite(value: float) -> float | None:
    """Return the value, or None if it is not finite."""
    return value if math.isfinite(value) else None
