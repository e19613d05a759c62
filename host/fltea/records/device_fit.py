"""What a device's own maximum-likelihood fit says of one axis: a part of the record `device_fit`."""

from typing import Literal

import msgspec

from fltea.records.fit import Interval, VerdictKind

DeviceVerdict = Literal["none", "white", "fractional", "relaxation"]
"""There is no spectrum; or white noise is not rejected; or it is, and the fractional model alone fits, or a
relaxation as well."""


class DeviceSpectrum(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The bins of the spectrum that were fitted."""

    hz: list[float]
    """Frequencies [Hz]."""
    density: list[float]
    """Noise density there, one-sided [(deg/s)/√Hz]."""
    ordinates: list[float]
    """Effective ordinates that the bin is made of."""


class DeviceAxisFit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The fit of one axis by the device; its verdict knows two models only."""

    verdict: DeviceVerdict
    """`none`: the axis is constant or has too many gaps; `white`: white noise is not rejected at 5 %;
    `fractional`: it is, and a relaxation is worse by more than 6 in 2 log L; `relaxation`: a relaxation
    describes the noise as well."""
    number: int
    """Fits of the axis since the device's start-up window, modulo 65,536."""
    age: int
    """Samples since that window, lost ones included, when the spectrum was read, modulo 2^32."""
    samples: int
    """Those of them that went into the spectrum, modulo 2^32."""
    ordinates: float
    """Effective independent ordinates of the spectrum."""
    evaluations: int
    """How often the likelihood was evaluated."""
    searched: bool
    """Fitted on a grid, without an earlier answer."""
    tuned: bool
    """The device's filters go on with `s2` and `R` as Q and R (a build with `FLTEA_TUNED=true`)."""
    bins_left_out: bool
    """Some of the lowest frequencies are missing, for lack of room."""
    ratio_white: float
    """2 log L of orders up to 1 above white noise."""
    ratio_relaxation: float
    """2 log L of the fractional model above a relaxation."""
    alpha: Interval = Interval()
    """Order α; value is null for `none` and `white`, an end where the data do not define it."""
    f: Interval = Interval()
    """Parameter f, without ends, as the device sends none [s^-α]."""
    s2: Interval = Interval()
    """Variance of the state's innovations, without ends [(deg/s)²]."""
    R: Interval = Interval()
    """Variance of the white noise, without ends: of an axis that is `white`, its power [(deg/s)²]."""
    alpha_difference: float | None = None
    """α minus that of the newest `fit`; null where one of them has none."""
    half_widths: float | None = None
    """The same in half-widths of that fit's interval."""
    host_verdict: VerdictKind | None = None
    """Verdict of the newest `fit`; null before the first."""
    spectrum: DeviceSpectrum | None = None
    """The bins that were fitted, with the first fit and every tenth, in a second record."""
    alpha_of_bins: float | None = None
    """With `spectrum`: order by this computer's fit of the same bins, in double precision."""
