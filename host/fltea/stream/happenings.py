"""Make records of steps of the bias and of motion.

A step or a motion is detected some samples after it began. Its record follows the sample at which it is
detected, and states the time at which it began.
"""

from collections.abc import Sequence

from fltea.estimator.tracker import BY_ACCEL, BY_CALLER, EventKind, TrackerEvent
from fltea.records.arrays import Mask
from fltea.records.clock import SECOND_NS
from fltea.records.records import Motion, Step
from fltea.stream.epoch import Moment

BY = {BY_ACCEL: "accel", BY_CALLER: "caller"}
"""Names in a record for what detected a motion, if that is not an axis of the sensor itself."""


def record_of(
    event: TrackerEvent, moment: Moment, axes: Sequence[str], unit: str, h: float, device: str | None
) -> Step | Motion:
    """Return the record of an event. `moment`: sample at which it was detected. `h`: sampling period [s].

    The time at which the event began is computed from the sampling rate. It is not looked up among earlier
    samples, so it does not depend on the blocks in which samples arrive.
    """
    before = max(event.ago - 1, 0)
    place = (
        moment.seq - before,
        moment.epoch,
        moment.device_us - round(before * h * 1e6),
        moment.host_ns - round(before * h * SECOND_NS),
    )
    if event.kind == EventKind.STEP:
        return Step(
            *place,
            axis=axes[event.axis],
            unit=unit,
            size=event.size,
            size_std=event.size_std,
            found_after=event.ago,
            device=device,
        )
    by = BY.get(event.axis) or axes[event.axis]
    if event.kind == EventKind.MOVES:
        return Motion(*place, begins=True, by=by, samples=None, largest=None, device=device)
    return Motion(*place, begins=False, by=by, samples=event.samples, largest=event.size, device=device)


def left_out(moving: Mask, events: Sequence[TrackerEvent]) -> Mask:
    """Return the mask (n, axes) of the samples that are left out of the noise spectrum.

    These are the samples in motion (`moving`), and those at which a step was detected. Where a sample is left
    out, a stretch of samples ends and another begins. So no stretch contains a step.
    """
    steps = [event for event in events if event.kind == EventKind.STEP]
    if not steps:
        return moving
    result = moving.copy()
    for event in steps:
        result[event.row, event.axis] = True
    return result
