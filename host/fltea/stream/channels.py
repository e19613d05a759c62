"""Run FLTEA's filters for the axes of one sensor on this computer."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

from fltea.estimator.bank import Bank
from fltea.estimator.lanes import Reason
from fltea.estimator.snapshot import OnlineState
from fltea.records.arrays import Array
from fltea.records.block import AxisColumns, Bools
from fltea.records.records import ACCEL_AXES, EstimatorInfo
from fltea.records.stats import AxisStats
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.innovation_whiteness import describes_order
from fltea.stream.epoch import Notice
from fltea.stream.live import NO_FIT, AcceptedFit
from fltea.stream.tuning import HandedOver, handed_over

LONGEST_BRIDGE = 30_000
"""Filters with unlimited memory bridge at most this many missing samples by prediction. The prediction over
this many samples takes half a second.
"""


class Channels:
    """The filters of the axes of one sensor, in the sensor's unit. The native device passes samples to them.

    `axes`: for each axis by its name, the index of its column in the sensor's samples. `h`: sampling period
    [s]. `resolution`: size of one LSB in the sensor's unit, None if unknown. `state`: a result of `save` to
    continue from.

    Raises:
        ValueError: no filter works with the settings, or the state does not fit them.
    """

    def __init__(
        self,
        axes: Mapping[str, int],
        config: EstimatorConfig,
        h: float,
        resolution: float | None,
        unit: str,
        state: OnlineState | None = None,
    ) -> None:
        self.config = config
        self._tuned = config.tuned_by == "live"
        self._names, self._unit = tuple(axes), unit
        self._fits: tuple[AcceptedFit, ...] = (NO_FIT,) * len(self._names)
        self.words: tuple[Any, ...] = self._words()
        """For each axis, the p-value of the null test for white noise (`null_p`), and whether this test
        rejects white noise (`whiteness`). Both come from the accepted fits. Until the next fit, all records
        have the same values.
        """
        self._known: dict[str, AcceptedFit] = {}
        self.bank = Bank(self._names, config, h, resolution, state)

    def columns(self, found: Sequence[Array | Bools]) -> AxisColumns:
        """Return the filters' results as columns of a block.

        `found`: the arrays with results that the native bank returned.
        """
        return AxisColumns._make((self._names, self._unit, *self.words, *found))

    def losses(self, lost: Iterable[tuple[int, int, Reason]]) -> list[tuple[str, Reason]]:
        """Return the axes whose filters became invalid, each with the reason."""
        return [(self._names[lane], why) for _, lane, why in lost]

    @property
    def waiting(self) -> list[bool]:
        """For each axis, whether a live fit has to set the variances of its filter and none has done so."""
        return [self._tuned and axis not in self.bank.tuned for axis in self._names]

    def use_model(self, accepted: Sequence[AcceptedFit]) -> None:
        """Use these accepted fits, one for each axis, from the next sample on."""
        self._fits = tuple(accepted)
        self.words = self._words()
        self._tune()

    def fill(self) -> None:
        """Begin to make estimates, since the start-up window is full."""
        self.bank.fill()
        self._tune()

    def _words(self) -> tuple[Any, ...]:
        return tuple(one.null_p for one in self._fits), tuple(one.whiteness for one in self._fits)

    def _tune(self) -> None:
        """Set the filters' variances and orders to those of the accepted fits."""
        if not self._tuned or self.bank.baseline is None:
            return
        new: dict[str, HandedOver] = {}
        for axis, accepted in zip(self._names, self._fits, strict=True):
            if accepted is self._known.get(axis):
                continue
            self._known[axis] = accepted
            if accepted.fit is None or accepted.whiteness != "rejected" or self._is_constant(axis):
                continue
            before = self.bank.variances[axis] if axis in self.bank.tuned else None
            handed = handed_over(accepted.fit, before)
            if handed is not None:
                new[axis] = handed
        if new:
            self.bank.retune(
                {axis: one.variances for axis, one in new.items()},
                {axis: one.filter_model for axis, one in new.items()},
            )

    def _is_constant(self, axis: str) -> bool:
        return self.bank.baseline is None or axis in self.bank.baseline.constant_axes

    def bridge(self, count: int) -> None:
        """Let the filters predict `count` samples, which came while the program did not run.

        At most as many samples are predicted as a filter's memory holds; with unlimited memory, at most
        `LONGEST_BRIDGE`.
        """
        self.bank.on_missing(min(count, self.config.window_samples or LONGEST_BRIDGE))

    def notices(self, host_ns: int) -> Iterator[Notice]:
        """Yield reports about axes that were constant in the start-up window.

        The method is called when the window is full.
        """
        baseline = self.bank.baseline
        for axis in baseline.constant_axes if baseline else ():
            remedy = "--set accel.R=9e-4" if axis in ACCEL_AXES else "--r 0.02"
            text = (
                f"{axis} did not change over the start-up window, so R is not known, and the axis "
                f"stays invalid. Is the sensor alive? If the data are right, give R: {remedy}."
            )
            yield Notice("constant_axis", text, host_ns)

    def save(self) -> OnlineState | None:
        """Return the filters' state for a later run; None until the start-up window is full."""
        return self.bank.save()

    @cached_property
    def info(self) -> EstimatorInfo:
        """Settings with which the filters of the axes run."""
        c = self.config
        return EstimatorInfo(
            c.variant,
            c.estimate_on,
            c.memory,
            c.guard,
            c.window_samples,
            c.startup_needed,
            _numbers(c.bias),
            _numbers(c.R),
            c.tuned_by,
        )

    def stats(self) -> Iterator[tuple[str, AxisStats]]:
        """Yield the statistics of each axis."""
        bank = self.bank
        baseline, restarts, interventions = bank.baseline, bank.restarts, bank.interventions
        lag1, nis, is_white = bank.lag1, bank.nis, bank.is_white
        for i, (name, fit) in enumerate(zip(self._names, self._fits, strict=True)):
            if baseline is None:
                yield name, AxisStats(None, None, 0, {}, unit=self._unit)
                continue
            Q, R = bank.variances[name]
            constant = name in baseline.constant_axes
            stands = fit.stands
            yield (
                name,
                AxisStats(
                    baseline.bias_dps[i],
                    None if constant else R,
                    restarts[name],
                    interventions[name],
                    lag1[name],
                    nis[name],
                    self._unit,
                    None if constant else Q,
                    name in bank.tuned,
                    describes_order(is_white[name], *bank.found(name), stands.alpha if stands else None),
                ),
            )


def _numbers(setting: str | float | list[float]) -> tuple[float, ...]:
    """Return the values of the setting `bias` or `R`.

    The result is empty if the start-up window determines them.
    """
    if isinstance(setting, str):
        return (0.0,) if setting == "none" else ()
    return tuple(setting) if isinstance(setting, list) else (setting,)


def explain_lost(axis: str, reason: Reason) -> tuple[str, str]:
    """Return kind and text of the `error` record for an axis that became invalid."""
    if reason == "runaway":
        return "axis_runaway", (
            f"{axis} ran away (order or parameter beyond all bounds) and begins again: an offset, a wrong R "
            "or a moving sensor does this to the unguarded algorithm. Use --guard consistent."
        )
    return "axis_bound", (
        f"{axis} needs the guard in more than a quarter of its samples, so it is not valid until that ends: "
        "is the sensor at rest, and does R (see stats) fit it?"
    )
