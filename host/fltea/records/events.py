"""What comes out of a port or a source, before it becomes records."""

from typing import NamedTuple

from fltea.records.records import DeviceStatus, EpochReason, Hello


class Opened(NamedTuple):
    """The port is open. unix_offset_ns: what to add to host_ns to get Unix time, as of then."""

    host_ns: int
    unix_offset_ns: int = 0


class Chunk(NamedTuple):
    """Bytes that arrived, with the monotonic time of their arrival."""

    data: bytes
    host_ns: int
    unix_offset_ns: int = 0


class Failed(NamedTuple):
    """The port could not be opened, or was lost; it will be tried again."""

    kind: str
    message: str
    host_ns: int
    unix_offset_ns: int = 0


TransportEvent = Opened | Chunk | Failed
"""What a port gives."""


class RawSample(NamedTuple):
    """One sample as the source has it: counts, and a sequence and a time that may still wrap.

    gyro is in LSB, or in deg/s where `Hello.gyro_lsb_per_dps` is null. host_ns is the arrival on
    the source's monotonic clock.
    """

    sequence: int
    device_us: int
    host_ns: int
    gyro: tuple[float, ...]
    accel: tuple[float, ...] | None = None
    temperature: float | None = None
    flags: int = 0


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


class Trouble(NamedTuple):
    """Something is wrong with the source; kind is one of the `error` kinds of host/README.md.

    fatal: under `--once` this ends the command.
    """

    kind: str
    message: str
    host_ns: int
    fatal: bool = True


class LinkDown(NamedTuple):
    """What follows may come from another device, so its HELLO has to be heard first."""

    host_ns: int


class Break(NamedTuple):
    """A recording says that an epoch begins with the next sample."""

    reason: EpochReason
    host_ns: int


class Tick(NamedTuple):
    """Nothing arrived for a while; lets statistics go out on time."""

    host_ns: int


Event = Hello | RawSample | DeviceStatus | DeviceAxis | DeviceEstimator | Trouble | LinkDown | Break | Tick
"""What a source gives."""
