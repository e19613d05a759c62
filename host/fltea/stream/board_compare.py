"""A board's estimate of an axis as records state it, alone or with its difference from the host's (pure)."""

import math
from typing import TypedDict

import msgspec

from fltea.records.events import DeviceAxis
from fltea.records.records import AxisEstimate, DeviceAxisEstimate, FlteaEstimate, WhyNot
from fltea.stream.live import SettledFit


def estimate_of(e: DeviceAxis, fit: SettledFit, known: AxisEstimate) -> AxisEstimate:
    """Return what is known of an axis, with the board's estimate in place of the host's filters."""
    valid, numbers = _numbers(e)
    of_board = FlteaEstimate(*numbers, valid, e.tuned)
    return msgspec.structs.replace(known, null_p=fit.null_p, whiteness=fit.whiteness, fltea=of_board)


def compare(
    e: DeviceAxis, known: AxisEstimate | None, host_age: int | None, same_settings: bool
) -> DeviceAxisEstimate:
    """Return the board's estimate, and its difference from the host's or why there is none.

    known: what the host knows after the same sample. host_age: steps since the start-up window of its
    filters; None where they estimate nothing.
    """
    valid, numbers = _numbers(e)
    host = None if known is None or host_age is None else known.fltea
    tracked = _tracked(e, None if known is None else known.bias)
    why_not = why_not_comparable(
        device_valid=valid,
        host_valid=host.valid if host else None,
        device_age=e.age,
        host_age=host_age or 0,
        device_skipped=e.skipped,
        same_settings=same_settings and not e.tuned,
    )
    if why_not is not None or host is None or host.alpha is None or host.f is None or host.state is None:
        return DeviceAxisEstimate(
            *numbers, valid, e.tuned, age=e.age, why_not=why_not or "host_not_valid", **tracked
        )
    return DeviceAxisEstimate(
        *numbers,
        valid,
        e.tuned,
        age=e.age,
        alpha_difference=finite(e.alpha - host.alpha),
        f_difference=finite(e.f - host.f),
        state_difference=finite(e.state_dps - host.state),
        **tracked,
    )


def why_not_comparable(
    *,
    device_valid: bool,
    host_valid: bool | None,
    device_age: int,
    host_age: int,
    device_skipped: bool,
    same_settings: bool,
) -> WhyNot | None:
    """Return why the estimates of board and host cannot be compared; None if they can.

    It is the first reason that applies, in the order of `records.why_not.WHY_NOT`. host_valid: None while
    there is no estimate. ages: steps since each one's start-up window, the first one is 1. device_skipped:
    its estimator skipped samples that the host took. same_settings: the host computes with the settings that
    the device states.
    """
    if not device_valid:
        return "device_not_valid"
    if host_valid is False:
        return "host_not_valid"
    if host_valid is None or host_age != device_age:
        return "other_start"
    if device_skipped:
        return "device_skipped"
    return None if same_settings else "other_settings"


class _Tracked(TypedDict, total=False):
    tracker_bias: float | None
    tracker_bias_std: float | None
    tracker_state: float | None
    tracker_state_std: float | None
    tracker_bias_difference: float | None


def _tracked(e: DeviceAxis, of_host: float | None) -> _Tracked:
    if e.tracker is None:
        return {}
    bias, bias_std, state, state_std = map(finite, e.tracker)
    return {
        "tracker_bias": bias,
        "tracker_bias_std": bias_std,
        "tracker_state": state,
        "tracker_state_std": state_std,
        "tracker_bias_difference": None if bias is None or of_host is None else bias - of_host,
    }


_Six = tuple[float | None, float | None, float | None, float | None, float | None, float | None]


def _numbers(e: DeviceAxis) -> tuple[bool, _Six]:
    """Return whether an estimate holds, and its numbers; null in place of any that is not finite."""
    if not (e.valid and all(map(math.isfinite, (e.alpha, e.alpha_std, e.f, e.f_std, e.state_dps)))):
        return False, (None, None, None, None, None, None)
    innovation = None if e.missing else finite(e.innovation_dps)
    return True, (e.alpha, e.alpha_std, e.f, e.f_std, e.state_dps, innovation)


def finite(value: float) -> float | None:
    """Return the value, or None if it is none of a number."""
    return value if math.isfinite(value) else None
