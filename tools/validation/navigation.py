"""Measures how good a plain Kalman filter is with the figures of `identify --gauss-markov`.

The filter knows only the file that this command writes.

For each noise, axes of sensors are identified from ten minutes at 100 Hz. The filter starts in two ways: at
the end of the record with the bias from the file, or a minute before that end without knowledge of the bias.
Then it predicts the error of the heading in the next five minutes. The result is the root mean square of
(error / predicted σ), which should be 1.
"""

import math
import zlib

import numpy as np
from fltea.identification.axis import IdentifyOptions, analyse
from fltea.identification.forecast_judge import FittedSystem, fitted_system
from fltea.identification.navigation_filter import NavigationFilter, navigation_filter
from fltea.identification.shared_walk import shared_walk
from fltea.noise.parts import Part, Relaxation, Walk
from fltea.records.arrays import Array
from scipy.signal import lfilter

from tools.validation.live_way import AXES
from tools.validation.runner import Options, Row, Task
from tools.validation.states import NOISES, H, state, white
from tools.validation.tables import Table, grouped

SEEDS, QUICK_SEEDS = 39, 6
"""Number of axes of each noise in a full and in a quick run."""
N, REST, AHEAD = 60_000, 6_000, 30_000
OFFSET = 3.0
TIMES_S = (1.0, 10.0, 60.0, 300.0)
KINDS: dict[str, tuple[Part, ...]] = {
    **NOISES,
    "relaxation of 0.05, 2 s": (Relaxation(0.05, 2.0),),
    "relaxations of 1 and 100 s": (Relaxation(0.05, 1.0), Relaxation(0.02, 100.0)),
    "walk, 0.00005 a sample": (Walk(0.00005 / math.sqrt(H)),),
    "white noise through an EMA of 0.2": (),
}
EMA = "white noise through an EMA of 0.2"


class PlainFilter:
    """A textbook Kalman filter. Its states are the bias and first-order Gauss-Markov processes."""

    def __init__(self, given: NavigationFilter) -> None:
        sigma = np.array([0.0, *(one.sigma for one in given.gauss_markov)])
        self.phi = np.array([1.0, *(math.exp(-H / one.tau_s) for one in given.gauss_markov)])
        self.Q = np.diag(sigma**2 * (1 - self.phi**2))
        self.Q[0, 0] = given.K**2 * H
        self.R = given.N**2 / H
        self.x, self.P = np.zeros(len(sigma)), np.diag(sigma**2)
        self.x[0], self.P[0, 0] = given.bias, given.bias_std**2

    def forget(self) -> None:
        """Forget the bias: give it a σ that is far larger than that of the noise."""
        self.x[:] = 0
        self.P[0, 0] = 1e4 * (self.R + self.P.sum())

    def rest(self, y: Array) -> None:
        """Update the filter with the samples of a sensor at rest."""
        for sample in y:
            self.x, self.P = self.phi * self.x, self.phi[:, None] * self.P * self.phi + self.Q
            gain = self.P.sum(axis=1) / (self.P.sum() + self.R)
            self.x = self.x + gain * (sample - self.x.sum())
            self.P = self.P - np.outer(gain, self.P.sum(axis=0))

    def ahead(self) -> tuple[Array, Array]:
        """Return the predicted error of the heading at each of `TIMES_S`, and the σ of this error."""
        n = len(self.x)
        A, G = np.diag([*self.phi, 1.0]), np.vstack([np.eye(n), np.full(n, H)])
        A[n, :n] = H * self.phi
        Q = G @ self.Q @ G.T
        Q[n, n] += self.R * H * H
        drifts, stds = [], []
        for t_s in TIMES_S:
            x, P, power, noise, count = np.append(self.x, 0.0), np.pad(self.P, (0, 1)), A, Q, round(t_s / H)
            while count:
                if count & 1:
                    x, P = power @ x, power @ P @ power.T + noise
                power, noise, count = power @ power, power @ noise @ power.T + noise, count >> 1
            drifts.append(float(x[n]))
            stds.append(math.sqrt(P[n, n]))
        return np.array(drifts), np.array(stds)


def tasks(options: Options) -> list[Task]:
    """Return a task for each noise."""
    return [Task(name, measure, (name, options.seeds), N) for name in KINDS if options.wanted(name)]


def measure(name: str, series: int) -> list[Row]:
    """Return one row for each series and time ahead, with heading error / σ.

    Each row has the results of two filters: one begins with the bias from the file, the other without a bias.
    """
    rng = np.random.default_rng((20261128, zlib.crc32(name.encode())))
    rows: list[Row] = []
    for number in range(series):
        if number % AXES == 0:
            ys = {f"gyro_{axis}": OFFSET + _noise(name, rng, N + AHEAD) for axis in range(AXES)}
            sensor = shared_walk({axis: _learned(y[:N]) for axis, y in ys.items()}, H)
        axis = f"gyro_{number % AXES}"
        y, given = ys[axis], navigation_filter(sensor[axis], ys[axis][:N], H)
        heading = H * np.cumsum(y[N:])[[round(t_s / H) - 1 for t_s in TIMES_S]]
        at_end, rested = PlainFilter(given), PlainFilter(given)
        rested.forget()
        rested.rest(y[N - REST : N])
        found = [((heading - drift) / std).tolist() for drift, std in (at_end.ahead(), rested.ahead())]
        forecast = [one.filter / one.forecast for one in given.heading_std]
        for t_s, end, rest, ratio in zip(TIMES_S, *found, forecast, strict=True):
            rows.append(
                {"noise": name, "series": number, "t_s": t_s, "end": end, "rest": rest, "ratio": ratio}
            )
    return rows


def _learned(y: Array) -> FittedSystem:
    parts = analyse(y, H, IdentifyOptions(shuffles=0)).figures.model.parts(H)
    return fitted_system(parts, y, H)


def _noise(name: str, rng: np.random.Generator, n: int) -> Array:
    if name == EMA:
        return np.asarray(lfilter([0.2], [1, -0.8], rng.normal(size=n + 200) * 0.1)[200:])
    return state(KINDS[name], rng, n) + white(KINDS[name], rng, n)


def tables(rows: list[Row]) -> list[Table | str]:
    """Return tables with a row for each noise and columns for the times ahead.

    The tables show heading error / σ, and the filter's σ divided by that of the forecast.
    """
    titles = {
        "end": "Heading error over σ, RMS, from the end of the record on",
        "rest": "The same of a filter that knew nothing and rested a minute",
    }
    columns = ("noise", *(f"{t_s:g} s" for t_s in TIMES_S))

    def table(title: str, key: str, squared: bool) -> Table:
        cells = []
        for name, those in grouped(rows, lambda row: row["noise"]).items():
            by_time = sorted(grouped(those, lambda row: row["t_s"]).items())
            values = [np.array([row[key] for row in at]) for _, at in by_time]
            figures = [math.sqrt(float((x**2).mean())) if squared else float(np.median(x)) for x in values]
            cells.append((str(name), *(f"{figure:.2f}" for figure in figures)))
        return Table(title, columns, cells)

    found: list[Table | str] = [table(title, key, True) for key, title in titles.items()]
    return [*found, table("σ of the filter over σ of `--forecast`, median", "ratio", False)]
