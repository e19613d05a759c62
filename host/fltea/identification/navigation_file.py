"""Write the parameters of a navigation filter to a file.

The parameters are given for continuous time, and for discrete time at the sampling rate.
"""

import math
from collections.abc import Mapping
from pathlib import Path

import msgspec

from fltea.identification.axis import AxisResult
from fltea.identification.axis_report import AxisReport
from fltea.identification.model_file import by_sensor, write_json
from fltea.identification.navigation_filter import NavigationFilter
from fltea.noise.part import ROWS
from fltea.records.errors import FlteaError
from fltea.records.fit import Interval
from fltea.records.version import __version__
from fltea.spectrum.estimated import Estimated
from fltea.spectrum.noise_figures import ModelSummary

FORMAT = "fltea-navigation-model"
VERSION = 4
"""Version of the format.

Since version 4 there is the field `filter`, with all parameters of a Kalman filter. It has numbers even where
a figure such as N or K was not found.
"""
STATES = {row.name for row in ROWS if "entry" in row.traits}
"""Names of the parts of the noise model whose figures have fields of their own in `NavigationAxis`, such as
`N`.
"""


class GaussMarkovState(msgspec.Struct, frozen=True):
    """A state of the filter: dx/dt = -x / τ + w, where w has the density q.

    Discrete: x_k = phi x_{k-1} + noise of variance s2.
    """

    sigma: Interval
    tau_s: Interval
    q: float
    """Density 2 σ² / τ."""
    phi: float
    s2: float


# Why more than 12 attributes: each is one field of the file for navigation filters.
class NavigationAxis(msgspec.Struct, frozen=True):
    """The entry of one axis: its figures with their intervals, and the filter that follows from them.

    A figure is null if it was not found. An end of an interval is null if it is not known. Nothing in
    `filter` is null.
    """

    unit: str
    model: str
    N: Interval
    """White noise density, in `unit` per √Hz."""
    K: Interval
    """Density of the random walk, in `unit` per √s."""
    Q: Interval
    """Quantisation noise, in `unit` · s."""
    gauss_markov: tuple[GaussMarkovState, ...]
    others: tuple[Estimated, ...]
    """Parts of the noise, and filters inside the sensor, for which a plain Kalman filter has no state."""
    drift_rate: Interval
    """Slope of the offset, in `unit` per s."""
    from_hz: float
    """Lowest frequency that the model describes [Hz]."""
    knee_hz: float | None
    """Corner frequency of the fastest relaxation [Hz].

    It is given only if N is null because white noise cannot be told from this relaxation; else it is null.
    """
    knee_density: float | None
    """Noise density at `knee_hz`, in the unit of N."""
    without_order: ModelSummary | None
    """The best model without a fractional order. It is given only if the noise has a fractional order, for
    which a filter has no state; else it is null.
    """
    filter: NavigationFilter
    """All parameters of a plain Kalman filter."""


class NavigationModels(msgspec.Struct, frozen=True):
    """The content of the file: one entry for each axis of the gyroscope and of the accelerometer."""

    rate_hz: float
    h_s: float
    source: str
    axes: dict[str, NavigationAxis]
    accel_axes: dict[str, NavigationAxis]
    fltea: str = __version__
    format: str = FORMAT
    version: int = VERSION


def navigation_axis(found: AxisResult, unit: str, plain: NavigationFilter) -> NavigationAxis:
    """Return the entry of an axis whose samples are in `unit`."""
    quantisation = [part.values["Q"] for part in found.parts if part.part == "quantisation"]
    return NavigationAxis(
        unit=unit,
        model=found.made_of,
        N=found.level.N,
        K=found.level.K,
        Q=quantisation[0] if quantisation else Interval(),
        gauss_markov=tuple(
            _state(part, 1 / found.rate_hz) for part in found.parts if part.part == "relaxation"
        ),
        others=tuple(part for part in found.parts if part.part not in STATES),
        drift_rate=found.drift_rate,
        from_hz=found.band.from_hz,
        knee_hz=found.level.knee_hz,
        knee_density=found.level.knee_density,
        without_order=found.models["plain"] if found.stands == "order" else None,
        filter=plain,
    )


def write_navigation(path: Path, axes: Mapping[str, AxisReport], rate_hz: float, source: str) -> None:
    """Write the file; it is written completely or not at all.

    Raises:
        FlteaError: the file cannot be written, or no filter works with the noise of an axis.
    """
    entries = {}
    for name, axis in axes.items():
        if axis.filter is None:
            raise FlteaError(
                f"--gauss-markov: {name}: no Kalman filter works with its noise, "
                f"{axis.result.made_of}, which is at the edge of what is stationary. Record longer, or leave "
                "the axis out (--channels)."
            )
        entries[name] = navigation_axis(axis.result, axis.unit, axis.filter)
    write_json(path, NavigationModels(rate_hz, 1 / rate_hz, source, *by_sensor(entries)))


def _state(part: Estimated, h: float) -> GaussMarkovState:
    sigma, tau = part.value("sigma"), part.value("tau_s")
    s2 = -(sigma**2) * math.expm1(-2 * h / tau)
    return GaussMarkovState(
        part.values["sigma"], part.values["tau_s"], 2 * sigma**2 / tau, math.exp(-h / tau), s2
    )
