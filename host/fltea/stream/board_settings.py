"""Convert the settings with which a device estimates into settings of the host's own filters."""

import msgspec

from fltea.records.events import DeviceEstimator
from fltea.records.records import EstimatorInfo
from fltea.settings.estimator import EstimatorConfig


def host_settings(stated: DeviceEstimator) -> EstimatorConfig:
    """Return settings with which the host's filters compute the same as the device's.

    The values in the settings are the single-precision numbers that the device uses. The host computes with
    them in double precision.

    Raises:
        ValueError: no filter of this host works with these settings.
    """
    order = {
        "P0": stated.alpha_P0,
        "Q0": stated.alpha_Q0,
        "alpha0": stated.alpha0,
        "delta": stated.alpha_delta,
    }
    parameter = {"P0": stated.parameter_P0, "Q0": stated.parameter_Q0, "delta": stated.parameter_delta}
    filters: dict[str, object]
    if stated.variant == "joint":
        if any(order[name] != value for name, value in parameter.items()):
            raise ValueError(
                "P0, Q0 or delta of order and parameter differ, but the joint filter has one for both"
            )
        filters = {"joint": {**order, "beta0": stated.parameter0}}
    else:
        filters = {"order": order, "parameter": {**parameter, "f0": stated.parameter0}}
    settings = {
        "estimate_on": "both",
        "window": 0,
        "variant": stated.variant,
        "guard": stated.guard,
        "startup": stated.startup,
        "bias": "startup",
        "R": "auto",
        "gate": stated.gate,
        "tuning": "startup",
        "state": {"P0": stated.state_P0, "Q": stated.state_Q, "x0": stated.state_x0},
        **filters,
    }
    return msgspec.convert(settings, EstimatorConfig)


def info_of(stated: DeviceEstimator) -> EstimatorInfo:
    """Return the estimator's part of the record `epoch` for a device that alone makes the estimates."""
    return EstimatorInfo(stated.variant, "device", "compressed", stated.guard, 0, stated.startup, (), ())


def unused_settings(config: EstimatorConfig) -> list[str]:
    """Return the dotted names of settings that the user has changed in vain, since the device has its own."""
    usual = EstimatorConfig(estimate_on=config.estimate_on)
    names = [name for name in config.__struct_fields__ if getattr(config, name) != getattr(usual, name)]
    return [f"estimator.{name}" for name in names]
