"""What one device may plausibly publish, by the time of the stream that keeps it (pure).

Who walks behind its time, after an outage or in another's place, finds hours of a device in a moment. So what
counts is when the stream took the messages, never when they are read.
"""

MESSAGE_BYTES = 200
"""What a message takes beyond its frames: objects, and the time to hand it on."""

SECOND_BYTES = 1 << 18
"""Of one device. 8,000 samples a second of 28 bytes, the fastest that a gyroscope of this kind gives with its
filter, have 224,000; a serial line of the protocol carries 25,000."""

BURST_BYTES = 64 * SECOND_BYTES
"""At once, as a board or a bridge sends what waited while the server was away: 1.5 hours of 100 samples a
second, five minutes of 2,000."""


class Allowance:
    """Bytes that each device may still publish: `BURST_BYTES`, and `SECOND_BYTES` more with each second."""

    def __init__(self) -> None:
        self._left: dict[str, tuple[float, int]] = {}

    def takes(self, device: str, size: int, stream_ns: int) -> bool:
        """Whether a message of `size` bytes, which the stream took at `stream_ns`, is within it."""
        left, before_ns = self._left.get(device, (float(BURST_BYTES), stream_ns))
        since_s = max(0, stream_ns - before_ns) * 1e-9  # a clock that is set back begins from there
        left = min(float(BURST_BYTES), left + SECOND_BYTES * since_s)
        fits = size <= left
        self._left[device] = (left - size if fits else left, stream_ns)
        return fits

    def forget(self, device: str) -> None:
        """Let a device begin with all of it."""
        self._left.pop(device, None)
