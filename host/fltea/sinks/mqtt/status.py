"""Follow the state of a device for its status, which the broker retains (`<prefix>/<device_id>/status`)."""

from typing import Literal

import msgspec

from fltea.records.clock import unix_offset_ns
from fltea.records.records import Hello

STALLED_NS = 2 * 10**9
"""Time without a sample after which a device is `stalled` [ns]."""

REPEAT_NS = 30 * 10**9
"""Time after which the status is published again [ns], since the last will of an older connection may have
replaced it at the broker.
"""

Level = Literal["online", "stalled", "offline"]
Reason = Literal["ended", "connection_lost", "replaced"]


class Status(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of the status topic, as JSON.

    `since_ns`: Unix time since which the device or program has had this status. It is null in a status that
    the broker publishes as the last will. `reason`: why the device or program is offline: `ended`,
    `connection_lost` (the broker lost the connection to the program), or `replaced` (by another board on the
    same port).
    """

    status: Level
    since_ns: int | None
    source: str
    device_id: str | None
    device: str
    reason: Reason | None = None


class DeviceStatus:
    """Follows the state of one board, which counts as `stalled` until its first sample.

    All times are on the clock of `host_ns`.

    `current`: the present status.
    """

    def __init__(self, device: str, hello: Hello, now_ns: int) -> None:
        self._device = device
        self._sample_ns: int | None = None
        self._published_ns = now_ns
        self.change("stalled", hello, now_ns)

    def change(self, level: Level, hello: Hello, now_ns: int) -> None:
        """Change the status; the new status begins at `now_ns`."""
        reason: Reason | None = "ended" if level == "offline" else None
        self.current = status_of(level, hello, self._device, now_ns, reason)

    def on_sample(self, hello: Hello, now_ns: int) -> bool:
        """Note that a sample has arrived, and return whether that has changed the status."""
        self._sample_ns = now_ns
        if self.current.status == "online":
            return False
        self.change("online", hello, now_ns)
        return True

    def check(self, hello: Hello, now_ns: int) -> bool:
        """Check whether the device has stopped sending samples.

        Return whether to publish the status now, because it has changed or because `REPEAT_NS` has passed.
        """
        if self._sample_ns is not None and now_ns - self._sample_ns > STALLED_NS:
            self._sample_ns = None
            self.change("stalled", hello, now_ns)
            return True
        return now_ns - self._published_ns >= REPEAT_NS

    def take(self, now_ns: int) -> Status:
        """Return the present status, and note that it is published now."""
        self._published_ns = now_ns
        return self.current


def status_of(
    level: Level, hello: Hello, device: str, now_ns: int | None, reason: Reason | None = None
) -> Status:
    """Return the status of a board.

    `now_ns`: time when the status began; None for a status in the last will.
    """
    since_ns = None if now_ns is None else now_ns + unix_offset_ns()
    return Status(level, since_ns, hello.source, hello.device_id, device, reason)
