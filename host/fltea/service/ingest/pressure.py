"""Whether this machine keeps up with its devices; the live fits give way if it does not, all alike."""

from fltea.records.events import Trouble
from fltea.stream.beside import Beside

LATE_NS = 10**9
"""A message that has waited for so long shows that the fits take time that the samples need."""

LOOKS = 3
"""So many looks in a row have to find it: many devices that begin together are no reason."""

CALM_NS = LATE_NS // 4
STEP_NS = 10 * 10**9
QUIET_NS = 60 * 10**9
SLOWEST = 64.0


class Pressure:
    """Lets the fits of all devices come more rarely while messages wait, and more often after a calm minute.

    Samples and estimates never give way: all frames are taken as long as the inbox has room.
    """

    def __init__(self, beside: Beside) -> None:
        self._beside = beside
        self._longest_ns = self._late_looks = 0
        self._changed_ns = self._late_ns = -QUIET_NS

    def waited(self, ns: int) -> None:
        """Take note of how long a message waited."""
        self._longest_ns = max(self._longest_ns, ns)

    def look(self, now_ns: int) -> Trouble | None:
        """Judge what happened since the last look; what is to be reported if that is news."""
        longest_ns, self._longest_ns = self._longest_ns, 0
        beside = self._beside
        if longest_ns > CALM_NS:
            self._late_ns = now_ns
        self._late_looks = self._late_looks + 1 if longest_ns > LATE_NS else 0
        if self._late_looks >= LOOKS and now_ns - self._changed_ns >= STEP_NS and beside.slower < SLOWEST:
            self._changed_ns = now_ns
            beside.slower *= 2
            text = (
                f"messages of {beside.devices} devices wait for {longest_ns * 1e-9:.1f} s, so the live fits "
                f"of all of them come {beside.slower:g} times more rarely; no sample is left out."
            )
            return Trouble("fits_slowed", text, now_ns, fatal=False)
        if beside.slower > 1 and now_ns - max(self._late_ns, self._changed_ns) >= QUIET_NS:
            self._changed_ns = now_ns
            beside.slower /= 2
        return None
