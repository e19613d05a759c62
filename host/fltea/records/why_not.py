"""Why `device_estimate` gives no differences, in words, for all that show it."""

from fltea.records.records import WhyNot

WHY_NOT: dict[WhyNot, str] = {
    "device_not_valid": "the device's estimate is not valid",
    "host_not_valid": "the host's estimate is not valid",
    "other_start": "the device began at another sample",
    "device_skipped": "the device skipped samples",
    "other_settings": "the host has other settings than the device",
}
"""Each reason in words; an earlier one is reported before a later one."""


def not_comparable(why: WhyNot) -> str:
    """Return a reason as it is shown in place of a difference."""
    return f"not comparable: {WHY_NOT[why]}"
