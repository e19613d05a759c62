"""Fit a noise model to each sensor's axes while samples arrive, and publish each fit as a record `fit`.

The spectrum is kept as sums over stretches of samples, as long as the sensor stays the same. A gap of any
length, a restart of the board or of its sensor, and the time between two runs (`--state`) end a stretch, but
the sums are kept. Another device, scale, filter, rate or set of axes begins new sums. So the samples of one
fit may span several epochs, while FLTEA's filters begin anew with each epoch.

A refit takes milliseconds. It works on a copy of the sums in the fit worker's thread, so that samples are
processed in the meantime. It takes effect at a sample that is chosen when the refit begins. Only if the refit
is not done by then do the samples wait for it. So the results do not depend on the speed of the machine.

Motion of the sensor is no noise, so samples in which the sensor's tracker detects motion are left out of the
sums.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple, Protocol

from msgspec.structs import replace

from fltea.estimator.tracker import Remembered
from fltea.records.estimate import Whiteness
from fltea.records.fit import AxisFit
from fltea.records.records import Fit, Hello
from fltea.records.sensor_kind import SENSOR_KINDS
from fltea.settings.config import Config
from fltea.spectrum.evidence import ANYTIME_LEVEL
from fltea.spectrum.live_axes import AxisRefit, LiveAxes
from fltea.stream.epoch import NEVER, Beginning, Moment, Saved
from fltea.stream.fit_times import Refit, RefitTimes, period_s, turn
from fltea.stream.fit_worker import FitWorker
from fltea.stream.tracked_models import TrackedModel, TrackedModelMaker

NO_VERDICT = ("too few samples",)
"""Verdicts of a fit that say nothing about the noise. Such a verdict never counts as stable."""
REFILTERED = 32
"""When a refit takes effect, the samples that the tracker remembers have to be filtered with the new noise
model, so that the tracker can test them for steps. The fit worker does so while this many samples are still
to come. Then only these are left for the device stream to filter (about 5 µs per axis).
"""
BREAK = 9
"""Between two stretches of samples, at least this many samples count as lost. The true number may be unknown.
"""


class AcceptedFit(NamedTuple):
    """The newest live fit of an axis that the estimates of this axis use.

    `null_p`: p-value of the null test for white noise; None before the first fit. It is rounded to three
    digits, since the last digits of a fit depend on the kind of processor. `stands`: the newest fit whose
    verdict is stable; a verdict becomes stable when two accepted fits in a row have it. `tracked_model`: the
    noise model that the bias tracker uses.
    """

    null_p: float | None = None
    whiteness: Whiteness | None = None
    fit: AxisFit | None = None
    stands: AxisFit | None = None
    tracked_model: TrackedModel | None = None

    def followed_by(self, refitted: AxisRefit, maker: TrackedModelMaker) -> "AcceptedFit":
        """Return the accepted fit that replaces this one after the refit `refitted`."""
        fit, tracked_model = refitted.fit, maker.tracked_model(refitted.noise, self.tracked_model)
        agreed = self.fit is not None and self.fit.verdict == fit.verdict and fit.verdict not in NO_VERDICT
        stands = fit if agreed or (self.stands and self.stands.verdict == fit.verdict) else self.stands
        if fit.null_p is None:
            return AcceptedFit(fit=fit, stands=stands, tracked_model=tracked_model)
        p = float(f"{fit.null_p:.3g}")
        whiteness: Whiteness = "rejected" if p < ANYTIME_LEVEL else "not rejected"
        return AcceptedFit(p, whiteness, fit, stands, tracked_model)


class Tracks(Protocol):
    """A tracker of the biases of one sensor's axes."""

    def maker(self, axis: str) -> TrackedModelMaker:
        """Return an object that makes tracker models from the samples of an axis remembered until now."""

    def remembered(self, axis: str) -> Remembered:
        """Return the newest samples of an axis, which the tracker remembers."""


class _Begun(NamedTuple):
    """A refit that began after the sample at `moment` and has not taken effect yet."""

    moment: Moment
    samples: int
    refit: Refit
    refits: dict[str, Callable[[], tuple[AxisFit, AcceptedFit]]]
    """For each axis, a function that waits for the refit's result and returns two fits: the new fit of the
    axis, and the accepted fit, which the estimates use after the refit has taken effect.
    """
    refilters: int
    """When the device stream has processed the sample of this number, the fit worker begins to filter the
    remembered samples with the new models.
    """
    refiltered: tuple[Callable[[], None], ...] = ()
    """For each axis, a function that waits until the axis's remembered samples are filtered."""


class Sums:
    """The spectral sums of all axes, which continue as long as each HELLO describes the same sensor.

    `identity`: what of a HELLO has to be equal. `rate_hz`: sampling rate. `of_sensors`: the sums of each
    sensor; empty if no axis is fitted.
    """

    def __init__(
        self, identity: tuple[object, ...] | None, rate_hz: float, of_sensors: dict[str, LiveAxes]
    ) -> None:
        self.identity, self.rate_hz, self.of_sensors = identity, rate_hz, of_sensors
        self._noticed = self._notices()

    @property
    def samples(self) -> int:
        """Number of samples in the sums."""
        return next(iter(self.of_sensors.values())).samples

    @property
    def has_news(self) -> bool:
        """Whether a step or a change of the noise was noticed since the last call of `note`."""
        return self._notices() != self._noticed

    def note(self) -> None:
        """Remember that a refit begins, to which the steps and changes noticed so far are known."""
        self._noticed = self._notices()

    def _notices(self) -> int:
        return sum(sums.noticed for sums in self.of_sensors.values())


class LiveFits:
    """Fits the noise of both sensors' axes, no matter whether this computer or the board makes estimates.

    The spectral sums continue as long as each HELLO describes the same sensor.

    `prompt`: whether samples arrive at the pace of a device, and not as fast as a file can be read.
    `watched`: whether an output shows the fits, so that fits that no estimate uses are made as well.
    `fit_worker`: makes the refits of all devices of this program. `number`: index of this device among the
    devices of the program, from 0.
    """

    def __init__(
        self,
        config: Config,
        *,
        prompt: bool = True,
        watched: bool = True,
        fit_worker: FitWorker | None = None,
        number: int = 0,
    ) -> None:
        self._config, self._number = config, number
        self._fit_worker = fit_worker or FitWorker()
        self._prompt, self._watched = prompt, watched
        self._begun: _Begun | None = None
        self._sums = Sums(None, 1.0, {})
        self._times = RefitTimes(1.0, grows=False, every=False)
        self._before_first = 0
        self._accepted: dict[str, AcceptedFit] = {}
        self._drawn_samples = 0
        self._last: Moment | None = None

    def begin(self, beginning: Beginning) -> dict[str, LiveAxes]:
        """Begin an epoch, and return the spectral sums of each sensor.

        The sums of the previous epoch, or the saved sums, are kept if the sensor is the same.

        Raises:
                ValueError: the saved sums are not valid; nothing has changed then.
        """
        hello, saved = beginning.hello, beginning.saved or Saved()
        axes = beginning.axes(self._config.channels)
        identity = (_identity_of(hello), *(tuple(axes.get(kind, ())) for kind in SENSOR_KINDS))
        if beginning.saved is None and identity == self._sums.identity:
            self.bridge(beginning.missing)
        else:
            h, of_live = 1.0 / hello.rate_hz, self._config.live
            of_sensors = {
                kind.name: LiveAxes(tuple(names), h, of_live, kind.unit, saved.of(kind).sums)
                for kind, names in axes.items()
            }
            self._sums = Sums(identity, hello.rate_hz, of_sensors)
            self._accepted, self._begun = {}, None
            grows = self._config.live.period_s is None
            self._times = RefitTimes(hello.rate_hz, grows=grows, every=self._watched)
        return self._sums.of_sensors

    def begin_numbers(self, seq: int) -> None:
        """Count the samples for refits from the epoch's first sample on, which has sequence number `seq`."""
        period = self._period()
        self._times.begin(period)
        self._before_first = seq - 1 + turn(self._fit_worker, self._number, period)
        # a refit that began in the previous epoch takes effect at the first sample of this epoch
        if self._begun is not None:
            self._begun = self._begun._replace(refit=self._begun.refit._replace(counts=1))

    def bridge(self, count: int) -> None:
        """End the present stretch of samples, after which `count` or more samples are missing."""
        for sums in self._sums.of_sensors.values():
            sums.skip(max(count, BREAK))

    @property
    def due(self) -> int:
        """Number of a coming sample: when it has been processed, `refit` has to be called."""
        if not self._sums.of_sensors:
            return NEVER
        refilters = NEVER if self._begun is None else self._begun.refilters
        return self._before_first + min(self._times.check, refilters)

    @property
    def counts(self) -> int:
        """Number of a coming sample: when it has been processed, the refit that has begun takes effect."""
        return NEVER if self._begun is None else self._before_first + self._begun.refit.counts

    def refit(self, moment: Moment, tracks: Callable[[str], Tracks]) -> None:
        """Begin a refit if one is due, and prepare the tracker for a refit that will soon take effect.

        To prepare the tracker, the fit worker filters the samples that the tracker remembers, with the new
        noise model.

        `moment`: number and times of the last processed sample; its number is at least the attribute `due`.
        `tracks`: function that returns the tracker of the sensor to which an axis belongs.
        """
        number = moment.seq - self._before_first
        self._refilter(number, tracks)
        if number < self._times.check:
            return
        samples, busy, news = self._sums.samples, self._begun is not None, self._sums.has_news
        refit = self._times.at(number, samples, self._period(), noticed=news, busy=busy)
        if refit is None:
            return
        self._sums.note()
        refits = {}
        for sums in self._sums.of_sensors.values():
            for axis, make in sums.refits(curves=refit.curves, fresh=refit.fresh).items():
                maker = tracks(axis).maker(axis) if refit.settles else None
                refits[axis] = self._fit_worker.begin(
                    partial(_with_accepted, make, self.accepted(axis), maker)
                )
        refilters = max(number, refit.counts - REFILTERED) if refit.settles else NEVER
        self._begun = _Begun(moment, samples, refit, refits, refilters)
        self._refilter(number, tracks)
        if refit.curves:
            self._drawn_samples = samples

    def _refilter(self, number: int, tracks: Callable[[str], Tracks]) -> None:
        """Let the fit worker filter the remembered samples with the new models, if this is due."""
        if self._begun is None or number < self._begun.refilters:
            return
        begun, to_come = self._begun, self._begun.refit.counts - number
        refiltered = tuple(
            self._fit_worker.begin(
                partial(_refiltered, refit, self.accepted(axis), tracks(axis).remembered(axis), to_come)
            )
            for axis, refit in begun.refits.items()
        )
        self._begun = begun._replace(refilters=NEVER, refiltered=refiltered)

    def counted(self) -> Iterator[Fit]:
        """Let the refit that has begun take effect now, and yield its record."""
        begun, self._begun = self._begun, None
        if begun is None:
            return
        # This thread asks for the fit of the last axis first, and makes the fit if the fit worker has not
        # begun it yet. The fit worker begins with the first axis, so the two threads share the work.
        refitted = {axis: begun.refits[axis]() for axis in reversed(begun.refits)}
        for wait in reversed(begun.refiltered):
            wait()
        self._accepted = {axis: accepted for axis, (_, accepted) in refitted.items()}
        found = {axis: self._with_stability(axis, refitted[axis][0]) for axis in begun.refits}
        yield Fit(*begun.moment, begun.samples, found, device=self._config.name)

    def last(self, moment: Moment | None) -> Iterator[Fit]:
        """Yield the fit at the end of the stream, of all samples and with curves.

        Nothing is yielded if such a fit has just been published.

        For a recording only this fit matters, and it agrees with that of `fltea identify`. `moment`: number
        and times of the last sample; None if there was no sample.
        """
        yield from self.counted()
        if not self._sums.of_sensors or moment in (None, self._last):
            return
        self._last = moment
        if self._prompt and self._sums.samples == self._drawn_samples:
            return
        assert moment is not None
        found: dict[str, AxisFit] = {}
        for sums in self._sums.of_sensors.values():
            found |= sums.fit(curves=True, last=not self._prompt)
        if self._prompt:
            found = {axis: self._with_stability(axis, one) for axis, one in found.items()}
        else:
            found = {axis: replace(one, stable=True) for axis, one in found.items()}
        yield Fit(*moment, self._sums.samples, found, device=self._config.name)

    def accepted(self, axis: str) -> AcceptedFit:
        """Return the fit that the next estimates of an axis use."""
        return self._accepted.get(axis, NO_FIT)

    def period_s(self) -> float | None:
        """Return the shortest time between two refits [s]; None if no axis is fitted."""
        return period_s(self._config, self._fit_worker) if self._sums.of_sensors else None

    def _period(self) -> int:
        """Return the smallest number of samples between two refits."""
        return max(1, round(period_s(self._config, self._fit_worker) * self._sums.rate_hz))

    def _with_stability(self, axis: str, fit: AxisFit) -> AxisFit:
        stands = self.accepted(axis).stands
        return replace(fit, stable=stands is not None and stands.verdict == fit.verdict)


NO_FIT = AcceptedFit()


def _with_accepted(
    make: Callable[[], AxisRefit], accepted: AcceptedFit, maker: TrackedModelMaker | None
) -> tuple[AxisFit, AcceptedFit]:
    refitted = make()
    return refitted.fit, accepted if maker is None else accepted.followed_by(refitted, maker)


def _refiltered(
    refit: Callable[[], tuple[AxisFit, AcceptedFit]],
    before: AcceptedFit,
    remembered: Remembered,
    to_come: int,
) -> None:
    tracked_model = refit()[1].tracked_model
    if tracked_model is not None and tracked_model is not before.tracked_model:
        tracked_model.tracker_model.refilter(remembered, to_come)


def accepted_by(fits: LiveFits | None) -> Callable[[str], AcceptedFit]:
    """Return a function that returns the accepted fit of an axis. If `fits` is None, it returns `NO_FIT`."""
    return (lambda axis: NO_FIT) if fits is None else fits.accepted


def _identity_of(hello: Hello) -> tuple[object, ...]:
    """Return the parts of a HELLO that have to be equal for the sensor's noise to be the same."""
    scales = hello.gyro_lsb_per_dps, hello.gyro_range_dps, hello.accel_lsb_per_g
    return hello.device_id, hello.who_am_i, hello.sensor, *scales, hello.gyro_dlpf_hz, hello.rate_hz
