"""The live fit: the spectrum of each sensor's axes, and a record `fit` in samples' own time.

The sums go on for as long as the sensor is the same: a gap of any length, a restart of the board or of its
sensor, and the time between two runs (`--state`) break the spectrum's stretches and lose none of its sums.
Another device, scale, filter, rate or set of axes begins again. So `samples` of a fit may be of several
epochs, where the filters begin with each.

A look takes milliseconds, for which no sample waits: it takes a copy of the sums, is made beside the walk,
and counts from a sample on that is fixed when it begins. Only if it is late the walk waits for it, there. So
nothing depends on how fast anybody is.

What a sensor that moves says is no noise: the sums leave out what its tracker calls motion.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple, Protocol

from msgspec.structs import replace

from fltea.estimator.tracker import Remembered
from fltea.records.fit import AxisFit
from fltea.records.records import ACCEL_UNIT, GYRO_UNIT, Fit, Hello, Whiteness
from fltea.settings.config import Config
from fltea.spectrum.evidence import ANYTIME_LEVEL
from fltea.spectrum.live_axes import LiveAxes, Looked
from fltea.stream.epoch import NEVER, Beginning, Moment, Saved
from fltea.stream.fit_times import Look, LookTimes, period_s, turn
from fltea.stream.fit_worker import FitWorker
from fltea.stream.learning import Learned, Learner

NO_VERDICT = ("too few samples",)
"""Kinds that say nothing of the noise."""
REFILTERED = 32
"""So many samples before a look counts, all that is remembered is filtered by the noise that it has found,
beside the walk. Only these samples are left to the walk then, some 5 µs an axis, and the test of
steps looks back no further than without it."""
BREAK = 9
"""Lost samples that are not bridged: where nobody knows how many are missing, so many are counted."""


class AcceptedFit(NamedTuple):
    """The live fit that estimates of an axis go by; null_p to three digits, None before the first fit.

    Another kind of processor may differ in the last digits of its figures.
    stands: the newest whose verdict is stable, which is one that two settled fits in a row have agreed on.
    learned: what the tracker goes by.
    """

    null_p: float | None = None
    whiteness: Whiteness | None = None
    fit: AxisFit | None = None
    stands: AxisFit | None = None
    learned: Learned | None = None

    def followed_by(self, looked: Looked, learner: Learner) -> "AcceptedFit":
        """Return the next one."""
        fit, learned = looked.fit, learner.learned(looked.noise, self.learned)
        agreed = self.fit is not None and self.fit.verdict == fit.verdict and fit.verdict not in NO_VERDICT
        stands = fit if agreed or (self.stands and self.stands.verdict == fit.verdict) else self.stands
        if fit.null_p is None:
            return AcceptedFit(fit=fit, stands=stands, learned=learned)
        p = float(f"{fit.null_p:.3g}")
        whiteness: Whiteness = "rejected" if p < ANYTIME_LEVEL else "not rejected"
        return AcceptedFit(p, whiteness, fit, stands, learned)


class Tracks(Protocol):
    """What tracks the biases of a sensor."""

    def learner(self, axis: str) -> Learner:
        """Return what is to learn from the samples of an axis until now."""

    def remembered(self, axis: str) -> Remembered:
        """Return what is remembered of them."""


class _Begun(NamedTuple):
    """A look that began after the sample at `moment`, and does not count yet."""

    moment: Moment
    samples: int
    look: Look
    looks: dict[str, Callable[[], tuple[AxisFit, AcceptedFit]]]
    """Of each axis what gives the fit, and what is settled from then on."""
    refilters: int
    """The number of the sample after which what is remembered is filtered anew."""
    refiltered: tuple[Callable[[], None], ...] = ()
    """What waits for that."""


class LiveFits:
    """Fits the axes of both sensors, whoever estimates them; the next HELLO decides whether anything is kept.

    prompt: samples come at their own pace. watched: somebody takes the fits, so that there are also those by
    which no estimate goes. beside: what looks of this program share. number: which of its devices this is.
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
        self._rate_hz = 1.0
        self._begun: _Begun | None = None
        self._sums: dict[str, LiveAxes] = {}
        self._of: tuple[object, ...] | None = None
        self._times = LookTimes(1.0, grows=False, every=False)
        self._noticed = 0
        self._before_first = 0
        self._settled: dict[str, AcceptedFit] = {}
        self._drawn_samples = 0
        self._last: Moment | None = None

    def begin(self, beginning: Beginning) -> dict[str, LiveAxes]:
        """Begin an epoch, with the sums of the one before or of what was saved if the sensor is the same.

        Returns the sums of each sensor.

        Raises:
            ValueError: what was saved is not sound; nothing has changed then.
        """
        hello, saved = beginning.hello, beginning.saved or Saved()
        gyro, accel = beginning.axes(self._config.channels)
        identity = (_sensor_of(hello), tuple(gyro), tuple(accel))
        if beginning.saved is None and identity == self._of:
            self.bridge(beginning.missing)
        else:
            h, of_live = 1.0 / hello.rate_hz, self._config.live
            self._sums = {
                name: LiveAxes(tuple(axes), h, of_live, unit, data)
                for name, axes, unit, data in (
                    ("gyro", gyro, GYRO_UNIT, saved.gyro_fit),
                    ("accel", accel, ACCEL_UNIT, saved.accel_fit),
                )
                if axes
            }
            self._settled, self._begun, self._of = {}, None, identity
            self._rate_hz = hello.rate_hz
            grows = self._config.live.period_s is None
            self._times = LookTimes(hello.rate_hz, grows=grows, every=self._watched)
            self._noticed = self._notices()
        return self._sums

    def begin_numbers(self, seq: int) -> None:
        """Take note of the number of the first sample of an epoch."""
        period = self._period()
        self._times.begin(period)
        self._before_first = seq - 1 + turn(self._fit_worker, self._number, period)
        if self._begun is not None:  # it counts from the first sample on
            self._begun = self._begun._replace(look=self._begun.look._replace(counts=1))

    def bridge(self, count: int) -> None:
        """Break all stretches: at least so many samples are missing."""
        for sums in self._sums.values():
            sums.skip(max(count, BREAK))

    @property
    def due(self) -> int:
        """The number of the next sample behind which `look` is to be called."""
        if not self._sums:
            return NEVER
        refilters = NEVER if self._begun is None else self._begun.refilters
        return self._before_first + min(self._times.check, refilters)

    @property
    def counts(self) -> int:
        """The number of the sample behind which the look that was begun counts."""
        return NEVER if self._begun is None else self._before_first + self._begun.look.counts

    def look(self, moment: Moment, tracks: Callable[[str], Tracks]) -> None:
        """Begin a look after a sample, `due` or a later one, if it is time, and what the last one needs.

        tracks: gives what tracks the bias of an axis.
        """
        number = moment.seq - self._before_first
        self._refilter(number, tracks)
        if number < self._times.check:
            return
        noticed, samples = self._notices(), self._samples
        busy, news = self._begun is not None, noticed != self._noticed
        look = self._times.at(number, samples, self._period(), noticed=news, busy=busy)
        if look is None:
            return
        self._noticed = noticed
        looks = {}
        for sums in self._sums.values():
            for axis, make in sums.look(curves=look.curves, fresh=look.fresh).items():
                learner = tracks(axis).learner(axis) if look.settles else None
                looks[axis] = self._fit_worker.begin(partial(_looked, make, self.accepted(axis), learner))
        refilters = max(number, look.counts - REFILTERED) if look.settles else NEVER
        self._begun = _Begun(moment, samples, look, looks, refilters)
        self._refilter(number, tracks)
        if look.curves:
            self._drawn_samples = samples

    def _refilter(self, number: int, tracks: Callable[[str], Tracks]) -> None:
        """Filter what is remembered, beside the walk, if it is time for that."""
        if self._begun is None or number < self._begun.refilters:
            return
        begun, to_come = self._begun, self._begun.look.counts - number
        refiltered = tuple(
            self._fit_worker.begin(
                partial(_refiltered, look, self.accepted(axis), tracks(axis).remembered(axis), to_come)
            )
            for axis, look in begun.looks.items()
        )
        self._begun = begun._replace(refilters=NEVER, refiltered=refiltered)

    def counted(self) -> Iterator[Fit]:
        """Let the look that was begun count from here on, and yield its record."""
        begun, self._begun = self._begun, None
        if begun is None:
            return
        # The last first: whoever makes them has begun with the others.
        looked = {axis: begun.looks[axis]() for axis in reversed(begun.looks)}
        for wait in reversed(begun.refiltered):
            wait()
        self._settled = {axis: accepted for axis, (_, accepted) in looked.items()}
        found = {axis: self._with_stability(axis, looked[axis][0]) for axis in begun.looks}
        yield Fit(*begun.moment, begun.samples, found, device=self._config.name)

    def last(self, moment: Moment | None) -> Iterator[Fit]:
        """A fit of everything with its curves, at the end; none if that has just been published.

        Of a recording it is the one look that counts, so it finds what `fltea identify` finds.
        moment: of the last sample; None if there was none.
        """
        yield from self.counted()
        if not self._sums or moment in (None, self._last):
            return
        self._last = moment
        if self._prompt and self._samples == self._drawn_samples:
            return
        assert moment is not None
        found: dict[str, AxisFit] = {}
        for sums in self._sums.values():
            found |= sums.fit(curves=True, last=not self._prompt)
        if self._prompt:
            found = {axis: self._with_stability(axis, one) for axis, one in found.items()}
        else:
            found = {axis: replace(one, stable=True) for axis, one in found.items()}
        yield Fit(*moment, self._samples, found, device=self._config.name)

    def accepted(self, axis: str) -> AcceptedFit:
        """Return the fit that the next estimates of an axis go by."""
        return self._settled.get(axis, NO_FIT)

    def period_s(self) -> float | None:
        """Return how often it fits at most; None where there is nothing to fit."""
        return period_s(self._config, self._fit_worker) if self._sums else None

    @property
    def _samples(self) -> int:
        return next(iter(self._sums.values())).samples

    def _period(self) -> int:
        """The samples from look to look at least."""
        return max(1, round(period_s(self._config, self._fit_worker) * self._rate_hz))

    def _notices(self) -> int:
        return sum(sums.noticed for sums in self._sums.values())

    def _with_stability(self, axis: str, fit: AxisFit) -> AxisFit:
        stands = self.accepted(axis).stands
        return replace(fit, stable=stands is not None and stands.verdict == fit.verdict)


NO_FIT = AcceptedFit()


def _looked(
    make: Callable[[], Looked], accepted: AcceptedFit, learner: Learner | None
) -> tuple[AxisFit, AcceptedFit]:
    looked = make()
    return looked.fit, accepted if learner is None else accepted.followed_by(looked, learner)


def _refiltered(
    look: Callable[[], tuple[AxisFit, AcceptedFit]], before: AcceptedFit, remembered: Remembered, to_come: int
) -> None:
    learned = look()[1].learned
    if learned is not None and learned is not before.learned:
        learned.tracker_model.refilter(remembered, to_come)


def accepted_by(fits: LiveFits | None) -> Callable[[str], AcceptedFit]:
    """Return what gives the fit of an axis; no fit where nothing is fitted."""
    return (lambda axis: NO_FIT) if fits is None else fits.accepted


def _sensor_of(hello: Hello) -> tuple[object, ...]:
    """What has to be the same for its noise to be the same."""
    scales = hello.gyro_lsb_per_dps, hello.gyro_range_dps, hello.accel_lsb_per_g
    return hello.device_id, hello.who_am_i, hello.sensor, *scales, hello.gyro_dlpf_hz, hello.rate_hz
