"""Report what a user has to know about a board that makes estimates itself.

Each message is given only once, or at most once a minute.
"""

from collections.abc import Iterator

import numpy as np

from fltea.records.events import DeviceAxis, DeviceEstimator, Ints
from fltea.records.repeat import REPEAT_NS, OnceAMinute
from fltea.settings.estimator import EstimatorConfig
from fltea.stream.board_settings import unused_settings
from fltea.stream.epoch import Notice

PATIENCE_NS = 5 * 10**9
"""A board that sends samples is reported if it has not described its estimator within this time [ns]."""


class BoardNotices:
    """Reports what is wrong with a board's estimates.

    `config`: the host's settings, which the board does not use.
    """

    def __init__(self, config: EstimatorConfig) -> None:
        self._config = config
        self._unused_reported = self._silence_reported = self._settings_reported = False
        self._waits_since_ns: int | None = None
        self._constant: set[str] = set()
        self._invalid = OnceAMinute()
        self._skipped: tuple[int, int | None] = (0, None)
        """How many samples the board's estimator had skipped at the last report about them, and the time of
        that report. The time is None until the board states for the first time how many it has skipped.
        """

    def begin(self) -> None:
        """Forget which constant axes were reported, since the filters restart."""
        self._constant.clear()

    def on_link_down(self) -> None:
        """Begin to watch anew for silence and skipped samples, since another board may come."""
        self._waits_since_ns = None
        self._skipped = (0, None)

    def unused(self, now_ns: int) -> Iterator[Notice]:
        """Report which of this computer's settings have no effect, since the board uses its own."""
        if self._unused_reported:
            return
        self._unused_reported = True
        unused = unused_settings(self._config)
        if unused:
            who = self._config.estimate_on
            text = (
                f"{', '.join(unused)}: not used with --estimate-on {who}, since the device estimates with "
                "the settings of its firmware" + (", and so does this computer." if who == "both" else ".")
            )
            yield Notice("settings_unused", text, now_ns)

    def silent_from(self, host_ns: Ints) -> int | None:
        """Return the index of the first sample at which the board has been silent for too long, or None.

        A board counts as silent here if it sends samples, but does not describe its estimator.
        """
        if self._silence_reported:
            return None
        if self._waits_since_ns is None:
            self._waits_since_ns = int(host_ns[0])
        late = np.flatnonzero(host_ns - self._waits_since_ns >= PATIENCE_NS)
        return int(late[0]) if len(late) else None

    def silence(self, now_ns: int) -> Notice:
        """Report that the board sends samples but no estimates."""
        self._silence_reported = True
        return Notice(
            "no_device_estimates",
            f"the device sends samples, but in {PATIENCE_NS // 10**9} s no estimates of its own: its "
            "firmware was built with estimation switched off, or is not one for the Due. Flash that of "
            "this program (fltea flash), or let this computer estimate: --estimate-on host.",
            now_ns,
        )

    def on_settings(self, problem: ValueError, now_ns: int) -> Iterator[Notice]:
        """Report that this computer's filters cannot work with the board's settings."""
        if self._settings_reported:
            return
        self._settings_reported = True
        text = f"this program cannot use the device's settings, so nothing is compared: {problem}."
        yield Notice("device_settings", text, now_ns)

    def on_estimator(self, stated: DeviceEstimator) -> Iterator[Notice]:
        """Report samples that the board's estimator skipped since the last report."""
        self._silence_reported = False
        before, before_ns = self._skipped
        if before_ns is None or stated.skipped < before:
            self._skipped = stated.skipped, stated.host_ns - REPEAT_NS
        elif stated.skipped > before and stated.host_ns - before_ns >= REPEAT_NS:
            self._skipped = stated.skipped, stated.host_ns
            yield Notice(
                "device_skipped",
                f"the device's estimator skipped {stated.skipped - before} samples ({stated.skipped} since "
                "its boot): it had fallen behind. So its estimates are of fewer samples than there were, and "
                "nothing is compared until it begins again. No sample is lost. A lower rate "
                "in the firmware's settings helps.",
                stated.host_ns,
            )

    def on_axis(self, e: DeviceAxis, before: DeviceAxis | None) -> Iterator[Notice]:
        """Report what is wrong with an axis for which only the board makes estimates.

        `before`: the estimate before `e`.
        """
        if e.constant and e.axis not in self._constant:
            self._constant.add(e.axis)
            text = (
                f"{e.axis} did not change over the device's start-up window, so R is not known, "
                "and the axis stays invalid until the device begins again. Is the sensor alive?"
            )
            yield Notice("constant_axis", text, e.host_ns)
        if before and before.valid and not e.valid and self._invalid.is_due(e.axis, e.host_ns):
            text = (
                f"{e.axis} is not valid any more, as the device states: it ran away, or needs the guard in "
                "more than a quarter of its samples. Is the sensor at rest, and does R (see stats) fit it?"
            )
            yield Notice("axis_bound", text, e.host_ns)
