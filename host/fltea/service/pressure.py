"""Whether this machine keeps up with its devices; the live fits give way if it does not, all alike."""

from fltea.records.ports import Report
from fltea.stream.fit_worker import FitWorker

LOOK_NS = 10**9
"""How often loops look at their devices, and at this."""

LATE_NS = 10**9
"""Samples that have waited for so long show that the fits take time that they need."""

LOOKS = 3
"""So many looks in a row have to find it: many devices that begin together are no reason."""

CALM_NS = LATE_NS // 4
STEP_NS = 10 * 10**9
QUIET_NS = 60 * 10**9
SLOWEST = 64.0


class Pressure:
    """Lets the fits of all devices come more rarely while samples wait, and more often after a calm minute.

    Samples and estimates never give way. report: is called whenever the fits become rarer.
    """

    def __init__(self, fit_worker: FitWorker, report: Report) -> None:
        self._fit_worker, self._report = fit_worker, report
        self._longest_ns = self._late_looks = 0
        self._changed_ns = self._late_ns = -QUIET_NS

    def waited(self, ns: int) -> None:
        """Take note of how long samples waited after they had arrived."""
        self._longest_ns = max(self._longest_ns, ns)

    def look(self, now_ns: int) -> None:
        """Judge what happened since the last look."""
        longest_ns, self._longest_ns = self._longest_ns, 0
        fit_worker = self._fit_worker
        if longest_ns > CALM_NS:
            self._late_ns = now_ns
        self._late_looks = self._late_looks + 1 if longest_ns > LATE_NS else 0
        if self._late_looks >= LOOKS and now_ns - self._changed_ns >= STEP_NS and fit_worker.slower < SLOWEST:
            self._changed_ns = now_ns
            fit_worker.slower *= 2
            text = (
                f"samples of {fit_worker.devices} devices wait for {longest_ns * 1e-9:.1f} s, so the live "
                f"fits of all of them come {fit_worker.slower:g} times more rarely; no sample is left out."
            )
            self._report("fits_slowed", text)
        elif fit_worker.slower > 1 and now_ns - max(self._late_ns, self._changed_ns) >= QUIET_NS:
            self._changed_ns = now_ns
            fit_worker.slower /= 2
