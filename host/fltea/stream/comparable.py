"""Whether a device's own estimate of an axis can be put beside the host's of the same sample, and why not."""

from fltea.records.records import WhyNot


def why_not_comparable(
    *,
    device_valid: bool,
    host_valid: bool | None,
    device_age: int,
    host_age: int,
    device_skipped: bool,
    same_settings: bool,
) -> WhyNot | None:
    """Why the two say nothing beside each other; None if their difference means something.

    The first reason that applies, in the order of `records.why_not.WHY_NOT`. host_valid: None while there is
    no estimate. ages: steps since each one's start-up window, the first one is 1. device_skipped: its
    estimator skipped samples that the host took. same_settings: the host computes with the settings that the
    device states.
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
