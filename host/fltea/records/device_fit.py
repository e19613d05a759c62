"""What a device's own maximum-likelihood fit says of one axis: a part of the record `device_fit`."""

from typing import Literal

import msgspec

from fltea.records.fit import Interval, VerdictKind

DeviceVerdict = Literal["none", "white", "fractional", "relaxation"]
"""There is no spectrum; or white noise is not rejected; or it is, and the fractional model alone fits, or a
relaxation as well."""


class DeviceSpectrum(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The bins of the spectrum that were fitted.

    density: of the noise, one-sided, in deg/s over √Hz; ordinates: effective ones that a bin is made of.
    """

    hz: list[float]
    density: list[float]
    ordinates: list[float]


class DeviceAxisFit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The fit of one axis by the device.

    number: fits of this axis since the device's start-up window, modulo 65,536. age: samples since that
    window, lost ones included, when the spectrum was read; samples: those of them that went into it, both
    modulo 2^32. ordinates: effective independent ordinates; bins_left_out: some of the lowest frequencies
    had no room. evaluations: of the likelihood; searched: on a grid, since there was no answer before, or
    one of far fewer samples. tuned: the filters there go on with s2 and R as Q and R. alpha: its interval
    is by the likelihood; null where the data do not define it. s2, R: (deg/s)²; of white
    noise R is its power. ratio_white, ratio_relaxation: 2 log L above these two. alpha_difference: minus
    that of this computer's newest fit, and by how many half-widths of its interval; null where one of
    them has no order. host_verdict: of that fit. alpha_of_bins: order by this computer's fit of the bins
    in `spectrum`; null too where bins of two stretches of samples have the same frequency, and where
    others came within a second.
    """

    verdict: DeviceVerdict
    number: int
    age: int
    samples: int
    ordinates: float
    evaluations: int
    searched: bool
    tuned: bool
    bins_left_out: bool
    ratio_white: float
    ratio_relaxation: float
    alpha: Interval = Interval()
    f: float | None = None
    s2: float | None = None
    R: float | None = None
    alpha_difference: float | None = None
    half_widths: float | None = None
    host_verdict: VerdictKind | None = None
    spectrum: DeviceSpectrum | None = None
    alpha_of_bins: float | None = None
