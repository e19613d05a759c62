"""Wake up a waiting thread. Native code that does not hold Python's lock can do that, too."""

import select

from fltea import _native


class WakeUp(_native.WakeUp):
    """A flag that stays set until it is cleared; one thread waits for it.

    Raises:
        OSError: no file descriptor is left.
    """

    def __init__(self) -> None:
        super().__init__()
        self._poll = select.poll()
        self._poll.register(self, select.POLLIN)

    def wait(self, timeout_s: float) -> bool:
        """Wait until the flag is set; return whether it was set within `timeout_s`."""
        return bool(self._poll.poll(timeout_s * 1e3))
