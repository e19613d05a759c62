"""Settings of an identification."""

from collections.abc import Sequence
from typing import Any

import msgspec

from fltea.identification.axis import IdentifyOptions
from fltea.identification.forecast import Asked
from fltea.records.errors import UsageError
from fltea.records.sensor_kind import GYROSCOPE, kind_of
from fltea.settings.estimator import AccelConfig, EstimatorConfig
from fltea.settings.live import LiveConfig


class Settings(msgspec.Struct, frozen=True):
    """Settings of an identification.

    `bias` and `R` of the estimators may be lists with one number for each channel.
    """

    options: IdentifyOptions
    """Options for all axes. `of_axis` returns the options of one axis: its settings of FLTEA may differ from
    those of other axes.
    """
    gyro: EstimatorConfig = EstimatorConfig()
    accel: AccelConfig = AccelConfig()
    details: bool = True
    """Whether to compute results that the short answer does not show.

    Such results are FLTEA's estimates, its estimates for shuffled copies of the samples, and the range of
    averaging times in which the model reproduces the Allan deviation.
    """
    figures: bool = False
    """Whether to compute the curves that are drawn in the pictures of a report."""
    forecast: Asked = False
    live: LiveConfig = LiveConfig()
    """Settings of the tracker: the largest step of a bias, and the time T of Bias(T)."""

    def of_axis(self, axis: str, channels: Sequence[str]) -> IdentifyOptions:
        """Return the options of one axis among the identified `channels`."""
        kind = kind_of(axis)
        config = self.gyro if kind is GYROSCOPE else self.accel
        index = [name for name in channels if name in kind.axes].index(axis)
        numbers: dict[str, Any] = {}
        for key in ("bias", "R"):
            value = getattr(config, key)
            if isinstance(value, list):
                if index >= len(value):
                    raise UsageError(
                        f"{key}: has {len(value)} numbers, but {axis} is axis {index + 1} of the sensor."
                    )
                numbers[key] = value[index]
        return msgspec.structs.replace(self.options, estimator=msgspec.structs.replace(config, **numbers))


def at_rate(options: IdentifyOptions, h: float) -> IdentifyOptions:
    """Return the options, with the estimator's durations converted from seconds to numbers of samples.

    `h`: sampling period [s].

    Raises UsageError if a duration has more samples than allowed.
    """
    try:
        return msgspec.structs.replace(options, estimator=options.estimator.at(1 / h))
    except ValueError as error:
        raise UsageError(f"{error}.") from error
