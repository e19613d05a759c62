"""Refit the noise of all devices less often while this machine is too slow for their samples."""

from fltea.records.ports import Report
from fltea.stream.fit_worker import FitWorker

CHECK_NS = 10**9
"""Time between two checks of how long samples wait [ns]."""

LATE_NS = 10**9
"""If samples wait longer than this, refits are assumed to take too much of the processor's time [ns]."""

CHECKS = 3
"""Refits become less frequent if this number of successive checks have found late samples. Late samples in a
single check are normal when many devices begin at the same time.
"""

CALM_NS = LATE_NS // 4
STEP_NS = 10 * 10**9
QUIET_NS = 60 * 10**9
SLOWEST = 64.0


class Pressure:
    """Makes refits less frequent while samples wait too long, and more frequent after a minute without delay.

    Samples and estimates are never left out. `report`: function that is called whenever refits become less
    frequent.
    """

    def __init__(self, fit_worker: FitWorker, report: Report) -> None:
        self._fit_worker, self._report = fit_worker, report
        self._longest_ns = self._late_looks = 0
        self._changed_ns = self._late_ns = -QUIET_NS

    def waited(self, ns: int) -> None:
        """Note how long samples waited after they had arrived [ns]."""
        self._longest_ns = max(self._longest_ns, ns)

    def check(self, now_ns: int) -> None:
        """Make refits less or more frequent, by the longest wait of samples since the last call."""
        longest_ns, self._longest_ns = self._longest_ns, 0
        fit_worker = self._fit_worker
        if longest_ns > CALM_NS:
            self._late_ns = now_ns
        self._late_looks = self._late_looks + 1 if longest_ns > LATE_NS else 0
        if (
            self._late_looks >= CHECKS
            and now_ns - self._changed_ns >= STEP_NS
            and fit_worker.slower < SLOWEST
        ):
            self._changed_ns = now_ns
            fit_worker.slower *= 2
            text = (
                f"samples of {fit_worker.devices} devices wait for {longest_ns * 1e-9:.1f} s, so live fits "
                f"are made {fit_worker.slower:g} times less often for all devices; no sample is left out."
            )
            self._report("fits_slowed", text)
        elif fit_worker.slower > 1 and now_ns - max(self._late_ns, self._changed_ns) >= QUIET_NS:
            self._changed_ns = now_ns
            fit_worker.slower /= 2
