"""Simulates noise of known order, for trials and tests: `synthetic:?alpha=0.3&f=-1.5`."""

import math
from collections.abc import Iterator
from urllib.parse import parse_qsl

import msgspec
import numpy as np

from fltea.diagnostics.asked import AskedSource
from fltea.diagnostics.finding import Finding, ok
from fltea.noise.simulation import FractionalNoise, quantise
from fltea.records import clock
from fltea.records.errors import UsageError
from fltea.records.events import SEQUENCE_WRAP, TIME_WRAP_US, Event, RawSample, block_of
from fltea.records.records import AXES, Hello
from fltea.records.stats import LinkStats
from fltea.settings.config import Config
from fltea.settings.estimator import LONGEST_WINDOW
from fltea.sources.opening import Named
from fltea.sources.pacing import sleep_until

PACE_S = 0.01
"""If the source runs in real time, the samples within this time are yielded together [s]. At 100 Hz, each
sample is yielded alone.
"""
AT_ONCE = 256
"""Number of samples in a block if the source runs at full speed."""


class NoiseSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of a simulated gyroscope. The defaults resemble an MPU-9250 with the range ±2000 deg/s.

    `alpha`, `f` [s^-α], `Q` [(deg/s)² s^-2α], `R` [(deg/s)²]: parameters of the model in
    `fltea.noise.simulation`.
    `lsb_per_dps`: number of counts in 1 deg/s; 0 means that the samples are not rounded to counts. `window`:
    number of earlier samples that the simulated noise remembers. `n`: number of samples; 0 means that they
    never end.
    """

    alpha: float = 0.3
    f: float = -1.5
    Q: float = 0.15
    R: float = 0.02
    offset_dps: float = 0.0
    rate_hz: float = 100.0
    lsb_per_dps: float = 16.4
    range_dps: float = 2000.0
    seed: int = 1
    window: int = 3000
    n: int = 0


class NoiseGenerator:
    """Simulates all axes, each with a random generator of its own.

    The samples are in counts. If they are not rounded, they are in deg/s.
    """

    def __init__(self, settings: NoiseSettings) -> None:
        self.settings = s = settings
        self._axes = [
            FractionalNoise(
                s.alpha, s.f, s.Q, s.R, 1.0 / s.rate_hz, s.window, np.random.default_rng((s.seed, i))
            )
            for i in range(len(AXES))
        ]

    def step(self) -> tuple[float, ...]:
        """Return the next sample of all axes."""
        s = self.settings
        y_dps = [axis.step()[0] + s.offset_dps for axis in self._axes]
        if not s.lsb_per_dps:
            return tuple(y_dps)
        return tuple(quantise(y_dps, s.lsb_per_dps, s.range_dps).tolist())


def parse_noise(query: str) -> NoiseSettings:
    """Return the settings in the text after `synthetic:`.

    Raises:
        UsageError: a key is unknown, or its value is not a possible number; the message names the key.
    """
    pairs = dict(parse_qsl(query.removeprefix("?"), keep_blank_values=True))
    try:
        settings = msgspec.convert(pairs, NoiseSettings, strict=False)
        for key, value in msgspec.structs.asdict(settings).items():
            if not math.isfinite(value):
                raise ValueError(f"{key} has to be a finite number, not {value}")
        if settings.rate_hz <= 0:
            raise ValueError(f"rate_hz has to be positive, not {settings.rate_hz:g}")
        if not 1 <= settings.window <= LONGEST_WINDOW:
            raise ValueError(f"window has to be 1 to {LONGEST_WINDOW} samples, not {settings.window}")
        if settings.n < 0:
            raise ValueError(f"n has to be 0 (no end) or more, not {settings.n}")
        # one sample is made, since wrong settings then raise an error: each part of the generator checks the
        # settings that it uses
        NoiseGenerator(settings).step()
    except msgspec.ValidationError as error:
        known = ", ".join(NoiseSettings.__struct_fields__)
        raise UsageError(f"synthetic:{query}: {error}. Known keys: {known}.") from error
    except ValueError as error:
        raise UsageError(f"synthetic:{query}: {error}.") from error
    return settings


class SyntheticSource:
    """Yields simulated samples as events, in real time or at full speed.

    `unix_offset_ns`: offset from the monotonic clock to Unix time [ns]. It is 0 at full speed, so that two
    runs give equal output.
    """

    live = False
    has_clock = True

    def __init__(self, query: str, *, realtime: bool) -> None:
        self.settings = parse_noise(query)
        self._realtime = self.prompt = realtime
        self._name = f"synthetic:{query}"
        self._closed = False
        self.unix_offset_ns = clock.unix_offset_ns() if realtime else 0

    def events(self) -> Iterator[Event]:
        """Yield a HELLO, and then the samples."""
        s = self.settings
        noise = NoiseGenerator(s)
        begin_ns = clock.host_ns() if self._realtime else 0
        yield Hello(
            source=self._name,
            host_ns=begin_ns,
            rate_hz=s.rate_hz,
            sampling_mode="simulated",
            gyro_range_dps=s.range_dps,
            gyro_lsb_per_dps=s.lsb_per_dps or None,
        )
        k, at_once = 0, max(1, round(s.rate_hz * PACE_S)) if self._realtime else AT_ONCE
        while not self._closed and (s.n == 0 or k < s.n):
            rows = []
            for number in range(k, min(k + at_once, s.n) if s.n else k + at_once):
                device_us = round(number * 1e6 / s.rate_hz)
                due_ns = begin_ns + device_us * 1000
                times = device_us % TIME_WRAP_US, due_ns
                rows.append(RawSample(number % SEQUENCE_WRAP, *times, noise.step()))
            if self._realtime:
                sleep_until(rows[-1].host_ns, lambda: self._closed)
                if self._closed:
                    return
            yield block_of(rows)
            k += len(rows)

    def link_stats(self) -> LinkStats:
        """Return zeros, since nothing can be lost without a wire."""
        return LinkStats()

    def close(self) -> None:
        """End the iteration of `events`."""
        self._closed = True


def open_named(named: Named, config: Config) -> SyntheticSource:
    """Return the source that simulates noise."""
    return SyntheticSource(named.place, realtime=config.pace != "fast")


def only_reader_of(named: Named) -> str:
    """Return "", since several sources may simulate the same noise."""
    return ""


def check_source(asked: AskedSource) -> Iterator[Finding]:
    """Yield that there is nothing to check."""
    yield ok("source", f"{asked.url}: synthetic noise")
