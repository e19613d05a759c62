"""Composite models as a navigation filter is set up with: continuous, and discrete at the sample rate."""

from collections.abc import Mapping
from pathlib import Path

import msgspec

from fltea.identification.allan import SQRT_HOUR
from fltea.identification.model_file import write_text
from fltea.records.records import ACCEL_AXES
from fltea.records.version import __version__
from fltea.spectrum.composite import Composite
from fltea.spectrum.composite_intervals import Estimate

FORMAT = "fltea-navigation-model"
VERSION = 2
"""Version 1 has no accel_axes; all else is the same."""


class GaussMarkovState(msgspec.Struct, frozen=True):
    """A state of the filter: dx/dt = -x / τ + w with w of density q; x_k = phi x_{k-1} + noise of s2."""

    sigma_dps: Estimate
    tau_s: Estimate
    q_dps2_per_s: float
    """2 σ² / τ."""
    phi: float
    s2_dps2: float


class NavigationAxis(msgspec.Struct, frozen=True):
    """One axis. A part that is None was not found; an end of an interval that is None is not known."""

    model: str
    N_dps_per_sqrt_hz: Estimate
    N_deg_per_sqrt_h: float
    K_dps_per_sqrt_s: Estimate | None
    Q_deg: Estimate | None
    gauss_markov: tuple[GaussMarkovState, ...]
    drift_dps_per_s: Estimate | None
    from_hz: float
    """Nothing is known of what is slower."""
    low_pass_hz: float | None
    """The parts are those before this filter."""


class AccelGaussMarkovState(msgspec.Struct, frozen=True):
    """The same as `GaussMarkovState`, for an accelerometer."""

    sigma_ms2: Estimate
    tau_s: Estimate
    q_ms2_2_per_s: float
    phi: float
    s2_ms2_2: float


class NavigationAccelAxis(msgspec.Struct, frozen=True):
    """The same as `NavigationAxis`, for an accelerometer, in m/s²."""

    model: str
    N_ms2_per_sqrt_hz: Estimate
    K_ms2_per_sqrt_s: Estimate | None
    Q_ms: Estimate | None
    gauss_markov: tuple[AccelGaussMarkovState, ...]
    drift_ms2_per_s: Estimate | None
    from_hz: float
    low_pass_hz: float | None


class NavigationModels(msgspec.Struct, frozen=True):
    """The axes of a gyroscope, and of an accelerometer."""

    rate_hz: float
    h_s: float
    source: str
    axes: dict[str, NavigationAxis]
    accel_axes: dict[str, NavigationAccelAxis]
    fltea: str = __version__
    format: str = FORMAT
    version: int = VERSION


def navigation_axis(found: Composite) -> NavigationAxis:
    """Return the entry of an axis whose samples y are in deg/s."""
    return NavigationAxis(
        model=found.name,
        N_dps_per_sqrt_hz=found.N,
        N_deg_per_sqrt_h=found.N.value * SQRT_HOUR,
        K_dps_per_sqrt_s=found.K,
        Q_deg=found.Q,
        gauss_markov=tuple(
            GaussMarkovState(part.sigma, part.tau_s, part.q, part.phi, part.s2) for part in found.gauss_markov
        ),
        drift_dps_per_s=found.drift_rate,
        from_hz=found.from_hz,
        low_pass_hz=found.low_pass_hz,
    )


def navigation_accel_axis(found: Composite) -> NavigationAccelAxis:
    """Return the entry of an axis whose samples y are in m/s²."""
    return NavigationAccelAxis(
        model=found.name,
        N_ms2_per_sqrt_hz=found.N,
        K_ms2_per_sqrt_s=found.K,
        Q_ms=found.Q,
        gauss_markov=tuple(
            AccelGaussMarkovState(part.sigma, part.tau_s, part.q, part.phi, part.s2)
            for part in found.gauss_markov
        ),
        drift_ms2_per_s=found.drift_rate,
        from_hz=found.from_hz,
        low_pass_hz=found.low_pass_hz,
    )


def write_navigation(path: Path, axes: Mapping[str, Composite], rate_hz: float, source: str) -> None:
    """Write the file; it appears whole or not at all.

    Raises:
        FlteaError: it cannot be written.
    """
    models = NavigationModels(
        rate_hz,
        1 / rate_hz,
        source,
        {name: navigation_axis(found) for name, found in axes.items() if name not in ACCEL_AXES},
        {name: navigation_accel_axis(found) for name, found in axes.items() if name in ACCEL_AXES},
    )
    write_text(path, msgspec.json.format(msgspec.json.encode(models), indent=2).decode() + "\n")
