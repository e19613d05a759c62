"""Whether a device's own estimate of an axis can be put beside the host's of the same sample, and why not."""

from typing import Literal

WhyNot = Literal[
    "no_device_estimate",
    "device_not_valid",
    "host_not_valid",
    "other_start",
    "device_skipped",
    "other_settings",
]

WHY_NOT: dict[WhyNot, str] = {
    "no_device_estimate": "no estimate of the device yet",
    "device_not_valid": "the device's estimate is not valid",
    "host_not_valid": "the host's estimate is not valid",
    "other_start": "the device began at another sample",
    "device_skipped": "the device skipped samples",
    "other_settings": "the host has other settings than the device",
}
"""Each reason in words."""


def why_not_comparable(
    *,
    device_valid: bool | None,
    host_valid: bool | None,
    device_age: int | None,
    host_age: int | None,
    device_skipped: bool,
    same_settings: bool,
) -> WhyNot | None:
    """Why the two say nothing beside each other; None if their difference means something.

    The first reason that applies, in the order of `WHY_NOT`. device_valid, host_valid: None while there is no
    estimate. ages: steps since each one's start-up window, the first one is 1; None while there are none.
    device_skipped: its estimator skipped samples that the host took. same_settings: the host computes with
    the settings that the device states.
    """
    if device_valid is None:
        return "no_device_estimate"
    if not device_valid:
        return "device_not_valid"
    if host_valid is False:
        return "host_not_valid"
    if host_valid is None or host_age != device_age:
        return "other_start"
    if device_skipped:
        return "device_skipped"
    return None if same_settings else "other_settings"
