"""Store the last estimates for a fractional difference, up to a fixed number."""

import numpy as np

from fltea.records.arrays import Array


class NewestFirst:
    """The last `window` arrays of one shape, the newest first, in one contiguous piece of memory.

    The buffer is twice as long as the window and is filled from its end to its beginning. When it is full,
    the stored arrays are copied to its end. So a push costs O(1) on average, and the content is always one
    slice.
    """

    def __init__(self, window: int, shape: tuple[int, ...] = ()) -> None:
        if window < 1:
            raise ValueError(f"window must be at least 1 sample, got {window}; the paper uses 3000")
        self.window = window
        self._buffer = np.empty((2 * window, *shape))
        self._start = 2 * window
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def push(self, value: Array | float) -> None:
        """Add `value` as the newest. If the window is full, the oldest value is dropped."""
        if self._start == 0:
            keep = self.window - 1
            self._start = 2 * self.window - keep
            self._buffer[self._start :] = self._buffer[:keep]
        self._start -= 1
        self._buffer[self._start] = value
        self._count = min(self._count + 1, self.window)

    @property
    def values(self) -> Array:
        """A view (len, *shape) of the stored values, the newest first. It is valid until the next push."""
        return self._buffer[self._start : self._start + self._count]
