"""Define the paper's experiments: simulated data with their true states, and the settings of the filters.

These experiments are from sections 6.1 (examples 1–3, known input) and 6.2 (unknown input) of Macias &
Sierociuk 2023; section 7 is in `gyroscope`. Every seed gives one run. A seed gives the same samples whatever
other seeds there are.

The paper does not give the saw-tooth of examples 1 and 2 (`SawTooth`), nor any number of section 6.2, so they
are chosen here. In the data of the examples, the process noise ω has the variance 1e-5, and is multiplied by
h^α with the rest of the brackets of equation (2). The filter's Q = 1e-5 is the variance that one step adds to
the state, after this multiplication. Both are as in the paper.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fltea.estimator.lane_settings import LaneSettings
from fltea.lab.reproduce import paper
from fltea.lab.reproduce.simulate import fractional_states, noises
from fltea.records.arrays import Array
from fltea.records.errors import UsageError
from fltea.settings.estimator import EstimatorConfig, OrderSettings, ParameterSettings, StateSettings

EXAMPLE_FILTERS = LaneSettings(
    EstimatorConfig(
        variant="triple",
        guard="off",
        state=StateSettings(P0=1.0, Q=1e-5, x0=0.0),
        order=OrderSettings(P0=0.05, Q0=0.005, alpha0=1.0, delta=0.5),
        parameter=ParameterSettings(P0=0.001, Q0=0.01, f0=0.0, delta=0.5),
    ),
    h=paper.H,
    R=paper.NOISE_R,
)
"""Settings of the three filters in the paper's section 6.1. All have the same R."""

STEP_VARIANCE = 0.15
GYROSCOPE_FILTERS = LaneSettings(
    EstimatorConfig(
        variant="triple",
        guard="off",
        state=StateSettings(P0=0.01, Q=STEP_VARIANCE, x0=0.0),
        order=OrderSettings(P0=0.01, Q0=0.1, alpha0=1.0, delta=0.5),
        parameter=ParameterSettings(P0=0.01, Q0=0.1, f0=0.0, delta=0.5),
    ),
    h=paper.GYRO_H,
    R=paper.GYRO_R["x"],
)
"""Settings of the filters in the paper's section 7.1, with the R of the x axis."""


@dataclass(frozen=True)
class SawTooth:
    """Input of the paper's examples 1 and 2, which rises from -amplitude to amplitude in each period.

    If the input is unipolar, it rises from 0.
    """

    amplitude: float = 1.0
    period_s: float = 1.0
    unipolar: bool = False

    def __post_init__(self) -> None:
        if not math.isfinite(self.amplitude):
            raise UsageError(f"the saw-tooth's amplitude has to be a finite number, not {self.amplitude}.")
        if not (math.isfinite(self.period_s) and self.period_s > 0):
            raise UsageError(f"the saw-tooth's period has to be > 0 s, not {self.period_s}.")

    def __str__(self) -> str:
        amplitude = abs(self.amplitude)
        size = f"0 to {amplitude:g}" if self.unipolar else f"±{amplitude:g}"
        start = 0.0 if self.unipolar else -self.amplitude
        return f"saw-tooth {size}, {1 / self.period_s:g} Hz, starting at {start:g}"

    def samples(self, n: int, h: float) -> Array:
        """Return the inputs u_0 .. u_{n-1} at the times 0, h, 2h, ..., shape (n,)."""
        phase = np.arange(n, dtype=np.float64) * h / self.period_s
        # 1e-9 is added since rounding may leave the phase just below a whole number, where a period begins
        phase -= np.floor(phase + 1e-9)
        return self.amplitude * (phase if self.unipolar else 2 * phase - 1)


@dataclass(frozen=True)
class Data:
    """Data of several runs of n samples. Each array is (n, runs)."""

    y: Array
    """Measurements y_1 .. y_n."""
    u: Array | None = None
    """Known inputs u_0 .. u_{n-1}."""
    x: Array | None = None
    """True states x_1 .. x_n."""


@dataclass(frozen=True)
class Scenario:
    """One experiment of the paper; `make` returns the data of one run for each seed."""

    title: str
    source: str
    """Description of the data, for every table and figure."""
    lengths: tuple[int, ...]
    """The lengths L to run, the longest first."""
    filters: LaneSettings
    R: float
    """Measurement variance that the filters assume."""
    samples: int
    make: Callable[[Sequence[int]], Data]
    alpha: Array | None = None
    """True orders α_1 .. α_n. None if not known: then runs with different L are compared with each other."""
    f: float | None = None
    """True parameter in s^-α."""
    unit: str = ""
    """Unit of y and x."""
    single: bool = False
    """Whether there is only one run, however many seeds are asked for."""


def example(
    number: int, sawtooth: SawTooth, samples: int = paper.SAMPLES, *, omega_outside: bool = False
) -> Scenario:
    """Return example 1, 2 or 3 of the paper's section 6.1.

    `omega_outside`: whether the process noise is added after the factor h^α, not within the brackets before
    it.
    """
    k = np.arange(1, samples + 1, dtype=np.float64)
    alpha = np.full(samples, 0.6) if number == 1 else 0.2 + 0.1 * k * paper.H
    gain = (paper.H**alpha)[:, np.newaxis]
    lengths = {1: tuple(paper.TABLE_2), 2: tuple(paper.TABLE_3), 3: tuple(paper.TABLE_4)}[number]

    def make(seeds: Sequence[int]) -> Data:
        drawn = [noises(seed, samples, paper.NOISE_Q, paper.NOISE_R) for seed in seeds]
        omega, v = (np.column_stack(noise) for noise in zip(*drawn, strict=True))
        if number == 3:  # the input has its own random generator, independent of the noises
            u = np.column_stack(
                [np.random.default_rng((seed, 3)).normal(0, math.sqrt(0.1), samples) for seed in seeds]
            )
        else:
            u = np.repeat(sawtooth.samples(samples, paper.H)[:, np.newaxis], len(seeds), axis=1)
        drive = u + omega / gain if omega_outside else u + omega
        x = fractional_states(alpha, paper.PARAMETER, drive, paper.H)
        return Data(x + v, u, x)

    return Scenario(
        title=f"Example {number}",
        source=str(sawtooth) if number != 3 else "Gaussian input of variance 0.1",
        lengths=lengths,
        filters=EXAMPLE_FILTERS,
        R=paper.NOISE_R,
        samples=samples,
        make=make,
        alpha=alpha,
        f=paper.PARAMETER,
    )


# Values for the experiment of the paper's section 6.2, which states none. The state x has the order α₁. The
# noise that drives x is white, or is fractional noise of order α₂. Sampling period, number of samples and
# filters are those of the gyroscope in section 7, where the paper has no known input either.
UNKNOWN_ALPHA, UNKNOWN_F = 0.4, -1.0
SOURCE_ALPHA, SOURCE_F = 0.3, -1.0
UNKNOWN_R, UNKNOWN_FILTER_R = 0.05, 0.3
"""UNKNOWN_R: variance of the measurement noise v. UNKNOWN_FILTER_R: the R that the filters use, which is
about the variance of y, as in the paper's section 7.

One step adds the variance STEP_VARIANCE to the state x, in the data and in the filters. So the white noise ω
has the variance Q with STEP_VARIANCE = h^(2 (α₁ + α₂)) Q. α₁ is the order of x, and α₂ that of the noise that
drives x (0 if it is white).

With R = 0.05 in the filters, the paper's algorithm diverges for every seed. The reason is that its filters of
order and parameter take the estimated state as exact.
"""


def unknown_input(*, fractional: bool, samples: int = paper.GYRO_SAMPLES) -> Scenario:
    """Return the experiment of the paper's section 6.2, with unknown input.

    `fractional`: whether the noise that drives the state is itself fractional; otherwise it is white.
    """
    alpha = np.full(samples, UNKNOWN_ALPHA)
    source_alpha = np.full(samples, SOURCE_ALPHA)
    h = paper.GYRO_H
    Q = STEP_VARIANCE / h ** (2 * (UNKNOWN_ALPHA + (SOURCE_ALPHA if fractional else 0.0)))

    def make(seeds: Sequence[int]) -> Data:
        drawn = [noises(seed, samples, Q, UNKNOWN_R) for seed in seeds]
        omega, v = (np.column_stack(noise) for noise in zip(*drawn, strict=True))
        source = fractional_states(source_alpha, SOURCE_F, omega, h) if fractional else omega
        x = fractional_states(alpha, UNKNOWN_F, source, h)
        return Data(x + v, None, x)

    return Scenario(
        title="Section 6.2",
        source=(f"source noise of order {SOURCE_ALPHA:g}" if fractional else "white source noise")
        + ", not known to the filters",
        lengths=paper.GYRO_LENGTHS,
        filters=replace(GYROSCOPE_FILTERS, R=UNKNOWN_FILTER_R),
        R=UNKNOWN_FILTER_R,
        samples=samples,
        make=make,
        alpha=alpha,
        f=UNKNOWN_F,
    )
