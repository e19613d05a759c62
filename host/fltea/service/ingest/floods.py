"""Limit how many bytes one device may publish per second.

The time of a message is the time at which the broker's stream received it, not the time at which it is read.
After an outage, or in place of another worker, a worker reads the messages of hours within seconds. If the
time of reading counted, these messages would exceed the limit.
"""

MESSAGE_BYTES = 200
"""This number of bytes is added to the size of each message, since even an empty message takes memory and
time.
"""

SECOND_BYTES = 1 << 18
"""One device may publish at most this number of bytes a second for a long time. An MPU-9250 gives at most
8,000 filtered samples a second of 28 bytes each, which is 224,000 bytes/s. A serial port of the wire protocol
carries 25,000 bytes/s.
"""

BURST_BYTES = 64 * SECOND_BYTES
"""One device may publish at most this number of bytes at once, for example after a board or bridge has kept
them during an outage. The number is enough for 1.5 hours of 100 samples a second, or five minutes of 2,000
samples a second.
"""


class Allowance:
    """Keeps account of the number of bytes that each device may still publish.

    The number begins with `BURST_BYTES`, which is also its maximum, and grows by `SECOND_BYTES` every second.
    """

    def __init__(self) -> None:
        self._left: dict[str, tuple[float, int]] = {}

    def takes(self, device: str, size: int, stream_ns: int) -> bool:
        """Return whether a message of `size` bytes is allowed, which the stream received at `stream_ns`."""
        left, before_ns = self._left.get(device, (float(BURST_BYTES), stream_ns))
        since_s = max(0, stream_ns - before_ns) * 1e-9  # if the clock was set back, no time has passed
        left = min(float(BURST_BYTES), left + SECOND_BYTES * since_s)
        fits = size <= left
        self._left[device] = (left - size if fits else left, stream_ns)
        return fits

    def forget(self, device: str) -> None:
        """Give a device its full allowance again."""
        self._left.pop(device, None)
