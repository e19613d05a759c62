"""Limit what one device may publish, by the time of the stream that keeps its messages.

A worker that reads late, after an outage or in place of another worker, gets hours of a device's messages at
once. So the time at which the stream took a message counts, and never the time at which it is read.
"""

MESSAGE_BYTES = 200
"""Bytes counted for a message in addition to its frames, for its objects and the time to pass it on."""

SECOND_BYTES = 1 << 18
"""Bytes per second of one device. A gyroscope of this kind gives at most 8,000 samples a second with its
filter, of 28 bytes each: 224,000. A serial port of the protocol carries 25,000."""

BURST_BYTES = 64 * SECOND_BYTES
"""Bytes that may come at once, as when a board or bridge sends what waited during an outage: 1.5 hours of
100 samples a second, or five minutes of 2,000."""


class Allowance:
    """Number of bytes that each device may still publish: `BURST_BYTES`, plus `SECOND_BYTES` every second."""

    def __init__(self) -> None:
        self._left: dict[str, tuple[float, int]] = {}

    def takes(self, device: str, size: int, stream_ns: int) -> bool:
        """Return whether a message of `size` bytes, which the stream took at `stream_ns`, is allowed."""
        left, before_ns = self._left.get(device, (float(BURST_BYTES), stream_ns))
        since_s = max(0, stream_ns - before_ns) * 1e-9  # no time passes when the clock is set back
        left = min(float(BURST_BYTES), left + SECOND_BYTES * since_s)
        fits = size <= left
        self._left[device] = (left - size if fits else left, stream_ns)
        return fits

    def forget(self, device: str) -> None:
        """Give a device its whole allowance again."""
        self._left.pop(device, None)
