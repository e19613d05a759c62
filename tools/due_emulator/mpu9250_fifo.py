"""The FIFO of the MPU-9250: whole accounting of what went in, came out and was lost."""

from collections import deque


class Fifo:
    """Bytes in order; a full one loses the oldest, or refuses the newest (CONFIG bit 6, register 26).

    size: bytes that it holds. It counts in bytes, as the chip does: after an overflow, what is read may begin
    within a sample.
    """

    def __init__(self) -> None:
        self.size = 0
        self._bytes: deque[int] = deque()
        self._last = 0
        self.written = self.read_out = self.lost = self.cleared = 0
        """Bytes offered, read, lost to overflow and thrown away by a reset, ever."""

    def __len__(self) -> int:
        return len(self._bytes)

    def push(self, data: bytes, stop_when_full: bool) -> bool:
        """Append bytes; return whether there was an overflow."""
        self.written += len(data)
        excess = max(0, len(self._bytes) + len(data) - self.size)
        self.lost += excess
        if stop_when_full:
            self._bytes.extend(data[: len(data) - excess])
        else:
            self._bytes.extend(data)
            for _ in range(excess):
                self._bytes.popleft()
        return excess > 0

    def pop(self) -> int:
        """Take the oldest byte; an empty FIFO repeats the last one (register 116)."""
        if self._bytes:
            self._last = self._bytes.popleft()
            self.read_out += 1
        return self._last

    def clear(self) -> None:
        """Throw everything away."""
        self.cleared += len(self._bytes)
        self._bytes.clear()
