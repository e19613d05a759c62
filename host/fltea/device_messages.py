"""What a device says of its own estimates, in units: ESTIMATE and ESTIMATOR of protocol/README.md."""

from typing import NamedTuple


class DeviceAxis(NamedTuple):
    """What the device itself makes of one axis after one sample.

    sequence: of the message; sample: of the sample, both may wrap. age: steps since the start-up window, the
    first one is 1. The numbers are the device's as they are: meaningless where not valid, finite or not.
    """

    sequence: int
    host_ns: int
    axis: str
    sample: int
    age: int
    valid: bool
    constant: bool
    missing: bool
    skipped: bool
    alpha: float
    alpha_std: float
    f: float
    f_std: float
    state_dps: float
    innovation_dps: float
    interventions: dict[str, int]


class DeviceEstimator(NamedTuple):
    """With what the device estimates, and how it gets on.

    Sequences have one entry for each of `AXES`; variances and states are in powers of deg/s. order and
    parameter are of the joint filter with variant "joint": parameter0 is then h^α f, else f.
    """

    host_ns: int
    variant: str
    guard: str
    startup: int
    max_gap: int
    every: int
    remaining: int
    begun: int
    queue: int
    skipped: int
    longest_axis_us: int
    restarts: tuple[int, ...]
    bias_dps: tuple[float, ...]
    R_dps2: tuple[float, ...]
    state_x0: float
    state_P0: float
    state_Q: float
    alpha0: float
    alpha_P0: float
    alpha_Q0: float
    alpha_delta: float
    parameter0: float
    parameter_P0: float
    parameter_Q0: float
    parameter_delta: float
    gate: float
