"""The estimates of one axis in the records `estimate` and `device_estimate`."""

from typing import Literal

import msgspec

from fltea.records.fit import Interval, VerdictKind
from fltea.records.sensor_kind import GYROSCOPE

Whiteness = Literal["not rejected", "rejected"]
"""Result that the test for white noise has in the newest fit. As long as white noise is not rejected, α is
undefined.
"""
WhyNot = Literal["device_not_valid", "host_not_valid", "other_start", "device_skipped", "other_settings"]
"""Reasons why a device's estimate cannot be compared with the host's. The module `why_not` explains each
reason to the user.
"""


class FlteaEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The estimates of the paper's filters for one axis after one sample; null where they are not valid."""

    alpha: float | None = None
    """Order α."""
    alpha_std: float | None = None
    """Standard deviation of α. As soon as the live fit tunes the filters, the fit's uncertainty is included.
    """
    f: float | None = None
    """Parameter f [s^-α]."""
    f_std: float | None = None
    """Standard deviation of f, computed like `alpha_std` [s^-α]."""
    state: float | None = None
    """State x̂ of the noise after the sample. The bias of the start-up window is subtracted [`unit`]."""
    innovation: float | None = None
    """Sample minus its prediction [`unit`]."""
    valid: bool = False
    """False if the estimate diverged, the axis was constant, or a device sent a number that is not finite."""
    settled: bool = False
    """False while the filters settle: α and f then say little about the noise. For a device's filters:
    whether these use the variances of the device's own fit.
    """


# Why more than 12 attributes: each is one field of the published record.
class AxisEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The estimates of one axis after one sample. A value that is not known is null."""

    verdict: VerdictKind | None
    """Kind of the noise by the newest record `fit` with a stable verdict; null before the first such record.
    """
    alpha: Interval
    """Order α of the fit that gave `verdict`; null if undefined."""
    f: Interval
    """Parameter f of the fit that gave `verdict`; null if undefined [s^-α]."""
    bias: float | None
    """Bias to subtract from the sample: the sensor's offset plus the state of its noise; null for the first
    samples [`unit`]."""
    bias_std: float | None
    """Standard deviation of the bias [`unit`]."""
    state: float | None
    """State of the noise, without the offset; for white noise 0, for a random walk the whole bias
    [`unit`]."""
    state_std: float | None
    """Standard deviation of the state [`unit`]."""
    innovation: float | None
    """Sample minus its prediction [`unit`]."""
    moving: bool
    """Whether the sensor is moving, so that the bias is only predicted and its σ grows."""
    null_p: float | None
    """p-value of the test for white noise in the newest record `fit`."""
    whiteness: Whiteness | None
    """Result of the test for white noise. `not rejected`: α is undefined. `rejected`: `null_p` is below a
    significance level, which is far below 5 % since the test is repeated with each fit. Null if `null_p` is
    null.
    """
    unit: str
    """`deg/s`; for axes of the accelerometer, which `--channels` names, `m/s^2`."""
    fltea: FlteaEstimate
    """The estimates of the paper's filters after the sample."""


class DeviceAxisEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The device's own estimate of one axis after one sample."""

    fltea: FlteaEstimate
    """The estimates of the paper's filters on the device after the sample."""
    unit: str = GYROSCOPE.unit
    """`deg/s`."""
    age: int
    """Number of steps of the axis's filters since the device's start-up window, missing samples included; 1
    after the first step.
    """
    tracker_bias: float | None = None
    """Bias (offset plus state) by the device's tracker, a Kalman filter with the model of the device's own
    fit; null before the device's first fit of the axis [deg/s].
    """
    tracker_bias_std: float | None = None
    """Standard deviation of `tracker_bias` [deg/s]."""
    tracker_state: float | None = None
    """State of the coloured part of the noise by the device's tracker, without the offset; 0 for white noise
    [deg/s].
    """
    tracker_state_std: float | None = None
    """Standard deviation of `tracker_state` [deg/s]."""
    tracker_bias_difference: float | None = None
    """`tracker_bias` minus the `bias` in `estimate` after the same sample [deg/s]. The two values come from
    different fits.
    """
    alpha_difference: float | None = None
    """The device's α minus this computer's after the same sample; null for the reason in `why_not`."""
    f_difference: float | None = None
    """The device's f minus this computer's after the same sample; null for the reason in `why_not` [s^-α]."""
    state_difference: float | None = None
    """The device's state minus this computer's after the same sample; null for the reason in `why_not`
    [deg/s].
    """
    why_not: WhyNot | None = None
    """Why the differences are null. `device_not_valid`: the device's estimate is not valid; `host_not_valid`:
    this computer's estimate is not valid; `other_start`: the device began to estimate at another sample;
    `device_skipped`: the device has skipped samples; `other_settings`: the settings differ, or the device
    uses the variances of its own fit.
    """
