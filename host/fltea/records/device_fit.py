"""Define the part of the record `device_fit` that holds the result of a device's own fit of one axis."""

from typing import Literal

import msgspec

from fltea.records.fit import Interval, VerdictKind

DeviceVerdict = Literal["none", "white", "fractional", "relaxation"]
"""Verdicts of a device's fit; `DeviceAxisFit.verdict` explains each."""


class DeviceSpectrum(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The bins of the spectrum that were fitted."""

    hz: list[float]
    """Frequencies of the bins [Hz]."""
    density: list[float]
    """One-sided noise density at these frequencies [(deg/s)/√Hz]."""
    ordinates: list[float]
    """Effective number of periodogram ordinates that are averaged in each bin."""


# Why more than 12 attributes: each is one field of the published record.
class DeviceAxisFit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The device's own fit of one axis, which compares white noise with only two other models."""

    verdict: DeviceVerdict
    """`none`: the axis is constant or has too many gaps. `white`: white noise is not rejected at 5 %.
    `fractional`: white noise is rejected, and `ratio_relaxation` is more than 6. `relaxation`: white noise is
    rejected, and `ratio_relaxation` is at most 6.
    """
    number: int
    """Number of fits of the axis since the device's start-up window, modulo 65,536."""
    age: int
    """Number of samples from the end of the start-up window to the spectrum of this fit, including lost
    samples, modulo 2^32.
    """
    samples: int
    """Number of samples from which the spectrum was computed, modulo 2^32."""
    ordinates: float
    """Effective number of independent ordinates of the spectrum."""
    evaluations: int
    """Number of evaluations of the likelihood."""
    searched: bool
    """Whether the fit began by trying a grid of orders. It does so if there was no earlier fit, or one of far
    fewer samples.
    """
    tuned: bool
    """Whether the device's filters now use this fit's `s2` as their variance Q of a step, and its `R` as
    their variance R of the white noise (in firmware built with `FLTEA_TUNED=true`).
    """
    bins_left_out: bool
    """Whether some of the lowest frequencies are missing, since the device's memory had no room for them."""
    ratio_white: float
    """2 log L (L: likelihood) of the fractional model with orders up to 1, minus that of white noise.
    """
    ratio_relaxation: float
    """2 log L of the fractional model, minus that of a relaxation (a first-order Gauss-Markov process)."""
    alpha: Interval = Interval()
    """Order α. The value is null for `none` and `white`. An end of the interval is null if the data do not
    determine this end.
    """
    f: Interval = Interval()
    """Parameter f [s^-α]. The ends of its interval are null, since the device does not send them."""
    s2: Interval = Interval()
    """Variance, for one sample, of the noise ω that drives the state; without an interval [(deg/s)²]."""
    R: Interval = Interval()
    """Variance of the white noise, without an interval; for `white`, the power of the axis [(deg/s)²]."""
    alpha_difference: float | None = None
    """α of this fit minus the α in the newest record `fit`; null if one of the two has no α."""
    half_widths: float | None = None
    """`alpha_difference` divided by the half-width of α's interval in the newest record `fit`."""
    host_verdict: VerdictKind | None = None
    """Verdict of the newest record `fit`; null before the first one."""
    spectrum: DeviceSpectrum | None = None
    """The bins that were fitted; null in most records. For the first of every ten fits, a device also sends
    the bins. They arrive after the fit, which is then published a second time, with its bins.
    """
    alpha_of_bins: float | None = None
    """Order α by this computer's fit of the bins in `spectrum`, in double precision; null without
    `spectrum`.
    """
