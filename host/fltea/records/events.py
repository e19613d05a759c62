"""Define the events of ports and sources, from which the pipeline makes records."""

from collections.abc import Iterator, Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.records.records import EpochReason, Hello
from fltea.records.stats import DeviceStatus

Ints = NDArray[np.int64]
Values = NDArray[np.float64] | NDArray[np.int16]


class Opened(NamedTuple):
    """The port was opened. `unix_offset_ns`: offset from `host_ns` to Unix time at that moment [ns]."""

    host_ns: int
    unix_offset_ns: int = 0


class Chunk(NamedTuple):
    """Bytes that arrived, with `host_ns`, the monotonic time of their arrival [ns]."""

    data: bytes
    host_ns: int
    unix_offset_ns: int = 0


class Reads(NamedTuple):
    """The bytes of successive reads of a port, with the time of each read.

    `end`: for each read, the offset in `data` at which the bytes of the read end (reads,).
    `host_ns`: monotonic time of each read; it never decreases [ns] (reads,).
    `unix_offset_ns`: offset from `host_ns` to Unix time [ns] (reads,).
    """

    data: bytes
    end: Ints
    host_ns: Ints
    unix_offset_ns: Ints

    @classmethod
    def of(cls, *chunks: Chunk) -> "Reads":
        """Return one or more chunks as `Reads`."""
        datas, *times = zip(*chunks, strict=True)
        return cls(b"".join(datas), np.array([*accumulate(map(len, datas))]), *map(np.array, times))

    def rows(self, begin: int, end: int) -> "Reads":
        """Return those reads whose indices are from `begin` to `end` - 1, with their bytes and times."""
        first = int(self.end[begin - 1]) if begin else 0
        rows = slice(begin, end)
        data = self.data[first : int(self.end[end - 1])]
        return Reads(data, self.end[rows] - first, self.host_ns[rows], self.unix_offset_ns[rows])

    def chunks(self) -> Iterator[Chunk]:
        """Yield each read as a chunk."""
        begin = 0
        for end, *times in zip(*(column.tolist() for column in self[1:]), strict=True):
            yield Chunk(self.data[begin:end], *times)
            begin = end


class Failed(NamedTuple):
    """The port could not be opened, or the connection was lost.

    The program will try to open the port again.
    """

    kind: str
    message: str
    host_ns: int
    unix_offset_ns: int = 0


TransportEvent = Opened | Chunk | Failed
"""The events of a port."""


SEQUENCE_WRAP = 1 << 16
TIME_WRAP_US = 1 << 32


class RawSample(NamedTuple):
    """One sample as the source sends it: raw counts, and a sequence number and a device time that may wrap.

    `gyro`: rates in LSB, or in deg/s if `Hello.gyro_lsb_per_dps` is null.
    `host_ns`: arrival time by the source's monotonic clock [ns].
    """

    sequence: int
    device_us: int
    host_ns: int
    gyro: tuple[float, ...]
    accel: tuple[float, ...] | None = None
    temperature: float | None = None
    flags: int = 0


class RawBlock(NamedTuple):
    """Successive samples as columns of n rows, with the fields of `RawSample`.

    `gyro` has the shape (n, axes), `accel` (n, 3), and all other columns (n,). `accel`, `temperature` and
    `flags` are None if the source does not send them.
    """

    sequence: Ints
    device_us: Ints
    host_ns: Ints
    gyro: Values
    accel: Values | None = None
    temperature: Values | None = None
    flags: Ints | None = None

    def rows(self, begin: int, end: int) -> "RawBlock":
        """Return a block of the rows from `begin` to before `end`."""
        return RawBlock._make(None if column is None else column[begin:end] for column in self)

    def samples(self) -> Iterator[RawSample]:
        """Yield the samples one by one."""
        n = len(self.sequence)
        accel = [None] * n if self.accel is None else map(tuple, self.accel.tolist())
        return map(
            RawSample,
            self.sequence.tolist(),
            self.device_us.tolist(),
            self.host_ns.tolist(),
            map(tuple, self.gyro.tolist()),
            accel,
            [None] * n if self.temperature is None else self.temperature.tolist(),
            [0] * n if self.flags is None else self.flags.tolist(),
        )


def block_of(samples: Sequence[RawSample]) -> RawBlock:
    """Return one or more samples as columns. All samples have the same number of axes and the same fields."""
    sequence, device_us, host_ns, gyro, accel, temperature, flags = zip(*samples, strict=True)
    first = samples[0]
    return RawBlock(
        np.array(sequence, dtype=np.int64),
        np.array(device_us, dtype=np.int64),
        np.array(host_ns, dtype=np.int64),
        np.array(gyro, dtype=np.float64),
        None if first.accel is None else np.array(accel, dtype=np.float64),
        None if first.temperature is None else np.array(temperature, dtype=np.float64),
        np.array(flags, dtype=np.int64),
    )


class DeviceTracker(NamedTuple):
    """Bias and state of one axis by the device's bias tracker, as the device sends them.

    The numbers may be NaN or infinite.
    """

    bias_dps: float
    bias_std_dps: float
    state_dps: float
    state_std_dps: float


# Why more than 12 attributes: each attribute is a field of the protocol's message.
class DeviceAxis(NamedTuple):
    """The device's own estimate of one axis after one sample.

    The numbers are as the device sends them, finite or not. If `valid` is false, they have no meaning.

    `sequence`: number of the message; it may wrap.
    `sample`: number of the sample; it may wrap.
    `age`: number of filter steps since the start-up window; it is 1 after the first step.
    `tracker`: None before the device's first fit of the axis.
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
    tuned: bool
    alpha: float
    alpha_std: float
    f: float
    f_std: float
    state_dps: float
    innovation_dps: float
    interventions: dict[str, int]
    tracker: DeviceTracker | None = None


# Why more than 12 attributes: each attribute is a field of the protocol's message.
class DeviceEstimator(NamedTuple):
    """The settings with which the device estimates, and the counters of its estimator.

    Tuples have one entry for each of `AXES`; states are in deg/s, variances in (deg/s)². Fields that begin
    with `parameter` belong to a parameter that the filters estimate. It is f with the variant "triple", and
    h^α f with "joint", where h is the sampling period.
    """

    host_ns: int
    variant: str
    guard: str
    startup: int
    max_gap: int
    every: int
    remaining: int
    begun: int
    fit_every: int
    queue: int
    skipped: int
    longest_axis_us: int
    longest_slice_us: int
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


# Why more than 12 attributes: each attribute is a field of the protocol's message.
class DeviceFit(NamedTuple):
    """The device's own fit of one axis, with numbers as the device sends them, even if not finite."""

    host_ns: int
    axis: str
    verdict: str
    alpha_defined: bool
    searched: bool
    bins_left_out: bool
    tuned: bool
    number: int
    age: int
    samples: int
    evaluations: int
    ordinates: float
    alpha: float
    alpha_std: float
    f: float
    s2_dps2: float
    R_dps2: float
    ratio_white: float
    ratio_relaxation: float


class DeviceBins(NamedTuple):
    """Some bins of the spectrum of the device's fit.

    `number`: number of the fit. `total`: number of all bins of the spectrum. `first`: index of the first bin
    in this event.
    """

    host_ns: int
    axis: str
    number: int
    first: int
    total: int
    hz: tuple[float, ...]
    ordinates: tuple[float, ...]
    density_dps2_per_hz: tuple[float, ...]


class Trouble(NamedTuple):
    """Something is wrong with the source.

    `kind`: one of the kinds of errors in host/docs/reference/errors.md.
    `fatal`: whether the program ends because of this event if `--once` is set.
    """

    kind: str
    message: str
    host_ns: int
    fatal: bool = True


class LinkDown(NamedTuple):
    """The connection was lost.

    Later samples may come from another device, so they cannot be used until a new HELLO has come.
    """

    host_ns: int


class Break(NamedTuple):
    """A recording states that a new epoch begins with the sample that follows in the recording."""

    reason: EpochReason
    host_ns: int


class Tick(NamedTuple):
    """Nothing has arrived for a while.

    This event is sent so that the pipeline still publishes statistics on time.
    """

    host_ns: int


DeviceSays = DeviceAxis | DeviceEstimator | DeviceFit | DeviceBins
"""The events that only a device with its own estimator sends."""

Event = Hello | RawBlock | DeviceStatus | DeviceSays | Trouble | LinkDown | Break | Tick
"""The events of a source."""


def host_ns_of(event: Event) -> int | None:
    """Return the time of an event by the source's monotonic clock [ns]; None if the event has no time.

    The time of a block is the time of its last sample.
    """
    if isinstance(event, RawBlock):
        return int(event.host_ns[-1])
    return None if isinstance(event, DeviceStatus) else event.host_ns
