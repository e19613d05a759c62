"""What happens to a sensor besides its samples, as records: steps of the bias, and motion (pure).

A step and a motion are known some samples after they have begun. Their records stand behind the sample with
which they are known, and state the time at which they began.
"""

from collections.abc import Sequence

from fltea.estimator.tracker import BY_ACCEL, BY_CALLER, EventKind, TrackerEvent
from fltea.records.arrays import Mask
from fltea.records.clock import SECOND_NS
from fltea.records.records import Motion, Step
from fltea.stream.epoch import Moment

BY = {BY_ACCEL: "accel", BY_CALLER: "caller"}
"""Who has shown motion, where that is no axis of the sensor."""


def record_of(
    event: TrackerEvent, moment: Moment, axes: Sequence[str], unit: str, h: float, device: str | None
) -> Step | Motion:
    """Return the record of what is known since a sample. moment: of that sample; h: sampling period in s.

    Times of samples before are found by the rate, so that they do not depend on how blocks are cut.
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
    """Return the samples that sums of the noise leave out, (n, axes): motion, and those at a step.

    With a sample that is left out a stretch of samples ends, so no spectrum goes across a step.
    """
    steps = [event for event in events if event.kind == EventKind.STEP]
    if not steps:
        return moving
    result = moving.copy()
    for event in steps:
        result[event.row, event.axis] = True
    return result
