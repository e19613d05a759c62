"""Texts for page and terminal: why a `device_estimate` has no difference to this computer's estimate."""

from fltea.records.estimate import WhyNot

WHY_NOT: dict[WhyNot, str] = {
    "device_not_valid": "the device's estimate is not valid",
    "host_not_valid": "the host's estimate is not valid",
    "other_start": "the device began at another sample",
    "device_skipped": "the device skipped samples",
    "other_settings": "the host has other settings than the device",
}
"""Text of each reason. If several reasons apply, the earliest in this list is reported."""


def not_comparable(why: WhyNot) -> str:
    """Return the text that is shown where the difference between device and host is not known."""
    return f"not comparable: {WHY_NOT[why]}"
