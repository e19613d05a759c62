"""What a thread waits for, and is rung by who need not have Python's lock."""

import select

from fltea import _native


class WakeUp(_native.WakeUp):
    """Rings until it is cleared; one thread waits for it.

    Raises:
        OSError: no descriptor is left.
    """

    def __init__(self) -> None:
        super().__init__()
        self._poll = select.poll()
        self._poll.register(self, select.POLLIN)

    def wait(self, timeout_s: float) -> bool:
        """Wait for it; whether it has been rung."""
        return bool(self._poll.poll(timeout_s * 1e3))
