"""Compares the tracker's bias on known noises with the bias by a filter that knows the noise.

That filter also knows the offset.

Each series, at 100 Hz, is white noise of 0.14 deg/s plus a state of one kind, which this program draws itself
by recursions. Each series is processed as the daemon does it: the tracker runs, and a new fit is made
whenever the record has grown by a tenth.
"""

import math
import zlib
from functools import cache
from typing import Any

import numpy as np
from fltea.estimator.tracker import Tracker, TrackerRules
from fltea.noise.filters import LowPass
from fltea.noise.parts import Arfima, Order, Part, Relaxation, Walk, White
from fltea.noise.system import system
from fltea.records.arrays import Array
from scipy import signal

from tools.validation.bias.noises import mean_ahead
from tools.validation.live_way import live_way
from tools.validation.recursions import FractionalState, fractional_noise
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped

SEEDS, QUICK_SEEDS = 60, 6
"""Number of series of each noise in a full and in a quick run."""
H, R, N = 0.01, 0.02, 20_000
AHEAD = 100
"""Number of samples in a second: the bias is predicted as the mean of the next second."""
SPANS = {"6–30 s": (600, 3_000), "60–200 s": (6_000, N)}
OVERSAMPLED = 8
"""Number of steps of the low-pass inside a sensor in one sampling period, since the low-pass acts before the
sensor samples.
"""

NOISES: dict[str, tuple[Part, ...]] = {
    "white": (),
    "walk, 0.002 a sample": (Walk(0.002 / math.sqrt(H)),),
    "walk, 0.0003 a sample": (Walk(0.0003 / math.sqrt(H)),),
    "relaxation of 2 s": (Relaxation(0.1, 2.0),),
    "relaxations of 0.2 and 10 s": (Relaxation(0.1, 0.2), Relaxation(0.1, 10.0)),
    "α .7, f -2, s2/R .3": (Order(0.7, -2.0, 0.3 * R / H**1.4),),
    "α .5, f -2, s2/R 1": (Order(0.5, -2.0, R / H),),
    "α .8, f -1, s2/R 3": (Order(0.8, -1.0, 3 * R / H**1.6),),
    "α .35, f -4, s2/R 1 (F < 0)": (Order(0.35, -4.0, R / H**0.7),),
    "1/f^0.9": (Arfima(0.45, 1e-9, 0.2 * R),),
    "low-pass of 20 Hz, relaxation of 1 s": (Relaxation(0.1, 1.0), LowPass(20.0, 2.0)),
}
"""For each noise: its parts in addition to white noise. If there is a low-pass among them, only the white
noise passes it.
"""


def tasks(options: Options) -> list[Task]:
    """Return a task for each noise."""
    return [Task(name, track, (name, options.seeds), N) for name in NOISES if options.wanted(name)]


def track(name: str, series: int) -> list[Row]:
    """Track the bias of several series of one noise.

    Returns one row for each span of time, with root mean squares of errors and how often the error is within
    2 σ.

    The bias is the expected mean of the next second, so it is compared with the state's mean over this
    second.
    """
    rng = np.random.default_rng((20261124, zlib.crc32(name.encode())))
    parts = NOISES[name]
    whole = np.stack([state(parts, rng, N + AHEAD) for _ in range(series)], axis=1)
    x, mean = whole[:N], mean_ahead(whole, AHEAD)
    y = x + np.stack([white(parts, rng, N) for _ in range(series)], axis=1)
    known = Tracker([0.0] * series, TrackerRules(ahead=AHEAD))
    for lane in range(series):
        known.set(lane, system((White(R), *parts), H, N))
    best = known.run(y).bias - mean
    bias, std, _, _ = live_way(y, H)
    rows = []
    for span, (begin, end) in SPANS.items():
        e, s = (bias - mean)[begin:end], std[begin:end]
        rows.append(
            {
                "noise": name,
                "span": span,
                "series": series,
                "y": _rms((y - mean)[begin:end]),
                "best": _rms(best[begin:end]),
                "bias": _rms(e),
                "within": float((np.abs(e) <= 2 * s).mean()),
            }
        )
    return rows


def _rms(e: Array) -> float:
    return math.sqrt(float((e**2).mean()))


def state(parts: tuple[Part, ...], rng: np.random.Generator, n: int) -> Array:
    """Return n samples of the sum of the parts, without the white noise."""
    x = np.zeros(n)
    for part in parts:
        match part:
            case Walk():
                x += np.cumsum(rng.normal(0, part.K * math.sqrt(H), n))
            case Relaxation():
                a, before = math.exp(-H / part.tau_s), round(20 * part.tau_s / H)
                driven = rng.normal(0, part.sigma * math.sqrt(1 - a * a), n + before)
                x += signal.lfilter([1.0], [1.0, -a], driven)[before:]
            case Order():
                x += math.sqrt(part.Q * H ** (2 * part.alpha)) * _fractional(part, n).draw(rng)
            case Arfima():
                x += math.sqrt(part.s2) * fractional_noise(part.d, n, rng)
    return x


@cache
def _fractional(part: Order, n: int) -> FractionalState:
    return FractionalState(part.alpha, H**part.alpha * part.f, n)


def white(parts: tuple[Part, ...], rng: np.random.Generator, n: int) -> Array:
    """Return n samples of the white noise, after the low-pass if there is one among the parts."""
    low = next((part for part in parts if isinstance(part, LowPass)), None)
    if low is None:
        return rng.normal(0, math.sqrt(R), n)
    b, a = signal.butter(round(low.poles), low.corner_hz, fs=OVERSAMPLED / H)
    fine = rng.normal(0, math.sqrt(R * OVERSAMPLED), (n + 500) * OVERSAMPLED)
    return np.asarray(signal.lfilter(b, a, fine)[500 * OVERSAMPLED :: OVERSAMPLED])


def tables(rows: list[Row]) -> list[Table | str]:
    """Return a table of the errors for each span of time, divided by the smallest possible errors."""
    cells: list[Any] = []
    for name, both in grouped(rows, lambda row: row["noise"]).items():
        errors = [f"{row['bias'] / (row['best'] if row['best'] > 1e-6 else row['y']):.3f}" for row in both]
        cells.append((str(name), *errors, *(f"{100 * row['within']:.0f} %" for row in both)))
    columns = ("noise", *(f"error, {span}" for span in SPANS), *(f"within 2 σ, {span}" for span in SPANS))
    return [Table("Bias: RMS error over the best possible (white: over y's own)", columns, cells)]
