"""The motion that the sensor measures: angular rate, acceleration and temperature at a given time.

The rate is piecewise constant. Value number k holds from half a period before the time of k periods until
half a period after that time. A program that reads the sensor at all multiples of the period therefore reads
each value exactly once.
"""

from pathlib import Path
from typing import NamedTuple, Protocol
from urllib.parse import parse_qsl

import msgspec
import numpy as np
from fltea.recording.csv_file import open_csv
from fltea.recording.files import Recording
from fltea.recording.npz_file import open_npz
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.settings.how import How
from fltea.sources.synthetic import NoiseGenerator, NoiseSettings, parse_noise

Vector = tuple[float, float, float]

ACCEL_STD_G = 0.004
"""Standard deviation of the accelerometer's noise [g]: 300 ug/sqrt(Hz) over 184 Hz (MPU-9250 product
specification, 3.2).
"""
ACCEL_PERIOD_NS = 1_000_000
ACCEL_ROWS = 4099
"""Number of rows of accelerometer noise, one per ms. After the last row the noise begins again. The number is
a prime: a program that samples every 10 ms reads all rows once before its values repeat.
"""
CELSIUS = 25.0
NS_PER_S = 1_000_000_000
RATES_HZ = (1e-3, 1e5)
"""Lowest and highest permitted rate at which the motion changes [Hz]."""
WITHOUT_MEANING = {
    "n": "the emulated board has no last sample",
    "lsb_per_dps": "the emulated sensor quantises by the range that the program has set",
    "range_dps": "the program sets the emulated sensor's range",
}
"""Keys of `fltea.sources.synthetic` that cannot be used here because the board decides their values. The
value for each key is the reason.
"""


class Motion(NamedTuple):
    """What the sensor measures: rate [deg/s], specific force [g], temperature [°C]."""

    rate_dps: Vector
    accel_g: Vector
    celsius: float


class World(Protocol):
    """The surroundings of a sensor chip, which give the motion that it measures."""

    def at(self, now_ns: int) -> Motion:
        """Return the motion at a time.

        Times of successive calls never decrease. As long as the motion does not change, the same object is
        returned.
        """


class Constant:
    """A motion that never changes, for tests."""

    def __init__(
        self,
        rate_dps: Vector = (0.0, 0.0, 0.0),
        accel_g: Vector = (0.0, 0.0, 1.0),
        celsius: float = CELSIUS,
    ) -> None:
        self.motion = Motion(rate_dps, accel_g, celsius)

    def at(self, now_ns: int) -> Motion:
        return self.motion


class Stepped:
    """A resting sensor whose rate takes the values of `next_rate`, one per period.

    The accelerometer measures 1 g along z, plus white noise that changes every ms, so that two measurements
    seldom give equal values. Equal seeds give equal motions.
    """

    def __init__(self, rate_hz: float, seed: int) -> None:
        self._period_ns = round(NS_PER_S / rate_hz)
        noise = np.random.default_rng((seed, len(AXES))).standard_normal((ACCEL_ROWS, 3))
        self._accel_g = (ACCEL_STD_G * noise + (0.0, 0.0, 1.0)).tolist()
        self._k = -1
        self._row = -1
        self._rate_now: Vector = (0.0, 0.0, 0.0)
        self._motion = Motion((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), CELSIUS)

    def at(self, now_ns: int) -> Motion:
        """Return the motion at a time.

        Raises:
            ValueError: the time lies before the period of the rate that the last call returned.
        """
        k = (2 * now_ns + self._period_ns) // (2 * self._period_ns)
        if k < self._k:
            raise ValueError(f"the motion has already passed {now_ns} ns")
        row = now_ns // ACCEL_PERIOD_NS % ACCEL_ROWS
        if k > self._k or row != self._row:
            while self._k < k:
                self._k += 1
                self._rate_now = self.next_rate(self._k)
            self._row = row
            x, y, z = self._accel_g[row]
            self._motion = Motion(self._rate_now, (x, y, z), CELSIUS)
        return self._motion

    def next_rate(self, k: int) -> Vector:
        """Return rate number `k` [deg/s]; called once for each `k`, in order."""
        raise NotImplementedError


class Fractional(Stepped):
    """Noise of known order.

    Its values are exactly those that `fltea.sources.synthetic` has before quantisation.
    """

    def __init__(self, settings: NoiseSettings) -> None:
        super().__init__(settings.rate_hz, settings.seed)
        self._noise = NoiseGenerator(msgspec.structs.replace(settings, lsb_per_dps=0.0))

    def next_rate(self, k: int) -> Vector:
        """Return the next value of the noise.

        FlteaError is raised if the noise has grown beyond finite numbers.
        """
        x, y, z = self._noise.step()
        return x, y, z


class Replayed(Stepped):
    """A recording that is replayed at one row per period, whatever its own rate is.

    After its end, the recording starts again.

    Axes that are missing in the recording are 0. Recorded accelerations are not used, because recordings do
    not state the accelerometer's scale.
    """

    def __init__(self, recording: Recording, rate_hz: float = 100.0, seed: int = 1) -> None:
        super().__init__(rate_hz, seed)
        rate = recording.gyro / (recording.lsb_per_dps or 1.0)
        self._rate_dps = np.pad(rate, ((0, 0), (0, len(AXES) - rate.shape[1])))
        self.rows = len(rate)
        self.laps = 0
        """Number of times that the recording has been replayed completely."""

    def next_rate(self, k: int) -> Vector:
        """Return row `k` of the recording, modulo its length."""
        self.laps = k // self.rows
        x, y, z = (float(v) for v in self._rate_dps[k % self.rows])
        return x, y, z


def fractional_world(query: str) -> Fractional:
    """Return the simulated rates of the sensor, by a text such as `alpha=0.3&f=-1.5&seed=7`.

    The text is what follows `synthetic:` in the name of a source.

    Raises:
        UsageError: a key is unknown, has an impossible value, or does not apply to this board.
    """
    settings = parse_noise(query)
    for key in dict(parse_qsl(query.removeprefix("?"), keep_blank_values=True)):
        if key in WITHOUT_MEANING:
            raise UsageError(f"noise {query}: {key} does not apply here; {WITHOUT_MEANING[key]}.")
    low_hz, high_hz = RATES_HZ
    if not low_hz <= settings.rate_hz <= high_hz:
        raise UsageError(f"noise {query}: rate_hz has to be {low_hz:g} to {high_hz:g} here.")
    return Fractional(settings)


def recorded_world(path: Path, rate_hz: float = 100.0, seed: int = 1) -> Replayed:
    """Return the motion of a recording that `fltea run --source replay:…` can read (.npz or .csv).

    Raises:
        UsageError: the file is not a recording of this kind.
    """
    stored = open_npz(path) if path.suffix.lower() == ".npz" else open_csv(path, How(rate_hz=rate_hz))
    return Replayed(stored.whole(), rate_hz, seed)
