"""The live fit of all axes of one sensor.

It accumulates sums over the samples, and returns an `AxisFit` for each axis on request.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from fltea.noise.parts import Part
from fltea.records.arrays import Array
from fltea.records.fit import AxisFit, FitHighPass, FitLowPass, FitSpectrum, Interval, Until
from fltea.settings.live import LiveConfig
from fltea.spectrum.allan_curve import fit_allan
from fltea.spectrum.angle_walk import angle_walk
from fltea.spectrum.candidate_models import FittedModel
from fltea.spectrum.evidence import ANYTIME_LEVEL, LEVEL
from fltea.spectrum.how_long import seconds_more
from fltea.spectrum.last_refit import LastRefit
from fltea.spectrum.octaves import BandCells, Counts, Octaves
from fltea.spectrum.periodogram import FEWEST, LOWEST, Periodogram, binned
from fltea.spectrum.spectral import Spectral, examine
from fltea.spectrum.verdict import decide, winner

POINTS = 150
"""The largest number of points of a published spectrum."""
SHORTEST_MEMORY = 256
"""The shortest memory that a live fit may have, in samples."""
FEWEST_SAMPLES = 2 * (FEWEST + LOWEST)
"""A fit needs at least this many samples. The spectrum of this many samples has FEWEST ordinates that can be
fitted.
"""
LONGEST_MOTION_S = 600.0
"""Longest motion that is left out [s]. When a motion has lasted this long without 1,024 samples at rest in a
row, its further samples count as noise.
"""
LEFT_OUT = "lost", "bridged", "knocked", "moved", "limited"
"""Kinds of samples that are left out or replaced. The names are those in the output record `fit`."""
BREAKS = "gaps", "knocks", "motions", "steps", "changes"
"""Kinds of breaks in the series of samples. The names are those in the output record `fit`."""
REMEMBERED = 2
"""A sample whose age is more than this many times the setting `memory_s` does not contribute to any figure.
"""


class Noise(NamedTuple):
    """The noise model of a fit, for the tracker of the bias.

    `parts`: parts of the model. `drifts`: whether the noise has drift that none of these parts describes.
    `samples`: number of samples in the fit.
    """

    parts: tuple[Part, ...]
    drifts: bool
    samples: int


class AxisRefit(NamedTuple):
    """The result of a refit of an axis: the fit, and the noise model (None if no model could be fitted)."""

    fit: AxisFit
    noise: Noise | None


class _Saved(msgspec.Struct, array_like=True, forbid_unknown_fields=True):
    axes: tuple[str, ...]
    h: float
    unit: str
    memory: float
    octaves: bytes


class LiveAxes:
    """Accumulates samples of `axes` and fits them.

    `h`: sampling period [s]. `unit`: unit of the samples. `saved`: the state that `save` returned in an
    earlier run, from which this object continues; None to begin without samples.

    Raises:
        ValueError: `saved` is damaged, or belongs to other axes or settings.
    """

    def __init__(
        self, axes: tuple[str, ...], h: float, settings: LiveConfig, unit: str, saved: bytes | None = None
    ) -> None:
        self.axes, self.h, self.unit = axes, h, unit
        self._target = settings.target
        self._memory = 0.0 if settings.memory_s is None else max(settings.memory_s / h, SHORTEST_MEMORY)
        self.octaves = self._restored(saved) if saved else Octaves(len(axes), self._memory)
        self._last_refits = [LastRefit() for _ in axes]

    @property
    def samples(self) -> int:
        """The number of samples that each axis has received so far."""
        return self.octaves.samples

    def add(self, y: Array, moving: NDArray[np.bool_] | None = None) -> None:
        """Add samples `y` (n, axes). Samples for which `moving` (n, axes) is set are left out as motion.

        When a motion has lasted longer than LONGEST_MOTION_S, its further samples count as noise.
        """
        self.octaves.add(y, moving, self.longest_motion)

    @property
    def longest_motion(self) -> int:
        """The largest number of samples in a row that are left out as motion.

        The further samples of a longer motion count as noise.
        """
        return round(LONGEST_MOTION_S / self.h)

    def skip(self, count: int) -> None:
        """Record that `count` samples of all axes were lost."""
        self.octaves.skip(count)

    @property
    def noticed(self) -> int:
        """The number of steps of the offset and changes of the noise's level so far, on all axes together."""
        return self.octaves.noticed

    def fit(self, *, curves: bool, last: bool = False) -> dict[str, AxisFit]:
        """Fit every axis, and return the fits by axis. The arguments are those of `refits`."""
        return {axis: make().fit for axis, make in self.refits(curves=curves, last=last).items()}

    def refits(
        self, *, curves: bool, last: bool = False, fresh: bool = False
    ) -> dict[str, Callable[[], AxisRefit]]:
        """Copy the present samples for a refit, and return a function per axis that refits the axis.

        The functions may run in any thread while samples arrive. But two functions for the same axis must
        never run at the same time.

        `curves`: whether to compute the spectrum and the Allan deviation as well. `last`: whether the record
        is complete. If so, it is tested at the significance level of a single test, as by `fltea identify`.
        `fresh`: whether to search again for models, peaks and changes; with `curves` that is always done. If
        both are False, the results of the last search are used until the record has grown by a tenth.
        """
        octaves = self.octaves.copy()
        level, fresh = LEVEL if last else ANYTIME_LEVEL, fresh or curves
        return {
            axis: partial(self._refit, octaves, lane, curves, level, fresh)
            for lane, axis in enumerate(self.axes)
        }

    def save(self) -> bytes:
        """Return the whole state. A later run of the program can continue from it."""
        return msgspec.msgpack.encode(_Saved(self.axes, self.h, self.unit, self._memory, self.octaves.save()))

    def _restored(self, saved: bytes) -> Octaves:
        try:
            found = msgspec.msgpack.decode(saved, type=_Saved)
        except msgspec.MsgspecError as error:
            raise ValueError(f"the saved sums are not sound: {error}") from error
        ours = self.axes, self.h, self.unit, self._memory
        if (found.axes, found.h, found.unit, found.memory) != ours:
            raise ValueError("the saved sums belong to other axes, or have another rate, unit or memory")
        return Octaves.restore(len(self.axes), self._memory, found.octaves)

    def _refit(self, octaves: Octaves, lane: int, curves: bool, level: float, fresh: bool) -> AxisRefit:
        if fresh:
            self._last_refits[lane].forget()
        counts = octaves.counts(lane)
        fit, noise = self._fit(octaves, lane, counts, curves, level)
        fit = replace(fit, left_out=_named(counts, LEFT_OUT), breaks=_named(counts, BREAKS))
        return AxisRefit(fit, noise)

    def _fit(self, octaves: Octaves, lane: int, counts: Counts, curves: bool, level: float) -> AxisRefit:
        if counts.constant and counts.used >= SHORTEST_MEMORY:
            text = "Constant: all samples are the same. Is the sensor asleep, or its range far too wide?"
            return AxisRefit(AxisFit("constant", text, self.unit), None)
        used = min(counts.used, round(REMEMBERED * self._memory)) if self._memory else counts.used
        try:
            whole, drift = octaves.lines_and_drift(lane, self.h)
            seen = examine(
                whole,
                used * self.h,
                used,
                cells=_cells(octaves, lane, self.h),
                drift=drift,
                level=level,
                last_refit=self._last_refits[lane],
            )
        except ValueError:
            needed = f"a fit needs {FEWEST_SAMPLES} samples without a break, and there are {counts.used:,}"
            text = f"Too few samples yet: {needed}."
            return AxisRefit(AxisFit("too few samples", text, self.unit), None)
        return self._axis_fit(octaves, lane, counts.used, seen, whole if curves else None)

    def _axis_fit(
        self, octaves: Octaves, lane: int, used: int, seen: Spectral, drawn: Periodogram | None
    ) -> AxisRefit:
        """Return the fit of an axis in the form of the output record, and its noise model.

        `used`: number of samples in the fit. `drawn`: the periodogram from which the published curves are
        made; None if no curves are wanted.
        """
        e, f = seen.evidence, seen.evidence.candidates
        verdict = decide(e)
        noise = winner(e, verdict)
        tracked = f.order if verdict.has_order and f.order is not None else noise
        order, seconds = verdict.order, None
        if order.alpha.value is not None and f.order is not None:
            longest_s = REMEMBERED * self._memory * self.h if self._memory else None
            seconds = seconds_more(f, f.order, self._target, longest_s)
        low_pass, behind = e.reading.low_pass, e.reading.high_pass
        N = angle_walk(f, noise)
        allan = spectrum = None
        if drawn is not None:
            spectrum = spectrum_of(drawn, noise)
            *sums, samples = octaves.allan(lane)
            allan = fit_allan(tuple(sums), samples, self.h, self.unit, f, noise, N.value)
        fit = AxisFit(
            verdict.kind,
            verdict.text,
            self.unit,
            e.p_all,
            order.alpha,
            order.f,
            order.F,
            order.s2,
            order.R if verdict.has_order else _R(N, self.h),
            verdict.odds,
            [(float(low), float(high)) for low, high in seen.band.notch_hz],
            low_pass=None if low_pass is None else FitLowPass(low_pass.corner_hz, low_pass.poles),
            high_pass=None
            if behind is None
            else FitHighPass(behind.high_pass.corner_hz, behind.high_pass.poles),
            until_s=Until(self._target, seconds),
            allan=allan,
            spectrum=spectrum,
        )
        return AxisRefit(fit, Noise(tracked.parts(self.h), e.drifts, used))


def _R(N: Interval, h: float) -> Interval:
    """Return the variance R of white noise with this angle random walk N."""
    value, low, high = (None if one is None else one**2 / h for one in (N.value, N.low, N.high))
    return Interval(value, low, high)


def _cells(octaves: Octaves, lane: int, h: float) -> Iterator[BandCells]:
    """Yield the powers of frequency bands over time.

    The powers are computed only when the search for a change asks for the first band.
    """
    yield from octaves.cells(lane, h)


def spectrum_of(whole: Periodogram, noise: FittedModel) -> FitSpectrum:
    """Return the spectrum for output, and the spectrum of the model `noise` at the same frequencies.

    All ordinates, including those that are not fitted, are averaged over at most POINTS bins.
    """
    data = binned(whole)
    starts = np.arange(0, len(data.lam), max(1, math.ceil(len(data.lam) / POINTS)))
    counts = np.add.reduceat(data.counts, starts)
    lam = np.add.reduceat(data.lam * data.counts, starts) / counts
    power = np.add.reduceat(data.power[0] * data.counts, starts) / counts
    to_density = 2 * whole.h
    model = np.sqrt(noise.spectrum(lam, whole.h) * to_density)
    hz = lam / (2 * np.pi * whole.h)
    return FitSpectrum(hz.tolist(), np.sqrt(power * to_density).tolist(), model.tolist())


def _named(counts: Counts, names: tuple[str, ...]) -> dict[str, int]:
    return {name: getattr(counts, name) for name in names}
