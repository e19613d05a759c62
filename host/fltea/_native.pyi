"""The native module of fltea, in C++.

It has the decoder of the wire, the reader of ports, the estimator engine, the bias tracker, running spectra,
fits of spectra, and, for tests, the device's encoder (firmware/core).
"""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

_V = NDArray[np.float64]
_Ints = NDArray[np.int64]
_Counts = NDArray[np.int16]

SCHEMA_HASH: int

# Hash of all source files that the module was built from (host/native/source_hash.py).
SOURCE_HASH: str

def crc32(data: bytes) -> int: ...
def cobs_encode(data: bytes) -> bytes: ...

# Raises ValueError if the payload is too long.
def encode_frame(type: int, sequence: int, device_us: int, payload: bytes) -> bytes: ...

# Raises ValueError if a value does not fit its field.
def encode_message(type: int, sequence: int, device_us: int, fields: tuple[Any, ...]) -> bytes: ...

# Returns seven int64 for each record of a decompressed MCAP chunk: kind, begin, end, channel, sequence,
# log_time, publish_time; the last four are 0 for all records except messages. Raises ValueError if a record
# extends beyond the end of the chunk.
def chunk_records(chunk: bytes) -> bytes: ...

# Writes the chunks of one MCAP file. `compression`: MCAP's name of the compression that `end` applies. Its
# methods raise ValueError if reads do not follow one another, or if there are not as many lines as times.
class McapChunks:
    def __init__(self, compression: str) -> None: ...

    # Size of the records in the current chunk [bytes].
    @property
    def size(self) -> int: ...

    # Adds a record that is no message, unchanged.
    def add_record(self, record: bytes) -> None: ...
    def add_message(self, channel: int, sequence: int, log_ns: int, publish_ns: int, data: bytes) -> None: ...

    # Adds one message for each read. `end`: where each read ends in `data`; `log_ns`, `publish_ns`: its
    # times.
    def add_reads(
        self,
        channel: int,
        sequence: int,
        data: bytes,
        end: _Ints,
        log_ns: _Ints,
        publish_ns: _Ints,
    ) -> None: ...

    # Adds one message for each line, without the line end.
    def add_lines(self, channel: int, log_ns: _Ints, lines: bytes) -> None: ...

    # Ends the chunk and returns its bytes with its index, for position `at` of the file; empty if the chunk
    # has no message. `packed`: function that compresses the records.
    def end(self, at: int, packed: Callable[[bytes], bytes]) -> bytes: ...

    # Returns for all ended chunks: the records of their index, first and last log time, number of chunks, and
    # number of messages by channel.
    def summary(self) -> tuple[bytes, int, int, int, dict[int, int]]: ...

# See fltea.wire.block_reader.
class Decoder:
    def __init__(self) -> None: ...

    # Returns all items that end in these bytes. First the n samples as columns: sequence, device_us, gyro (n,
    # 3), accel (n, 3), temperature, flags, end; None if there are no samples. Then all other items in order:
    # number of samples before the item, end, reason (None for an intact frame), type, sequence, device_us
    # (all three 0 if there is a reason), payload or block. Raises TypeError if `data` is not bytes-like, and
    # BufferError if its memory is not contiguous.
    def feed(
        self, data: bytes | bytearray | memoryview
    ) -> tuple[
        tuple[
            NDArray[np.uint16],
            NDArray[np.uint32],
            NDArray[np.int16],
            NDArray[np.int16],
            NDArray[np.int16],
            NDArray[np.uint8],
            NDArray[np.int64],
        ]
        | None,
        list[tuple[int, int, str | None, int, int, int, bytes]],
    ]: ...

    # Drops the unfinished block, as needed after a port was closed and opened again.
    def reset(self) -> None: ...
    @property
    def pending(self) -> int: ...

# A signal that a thread waits for with select.poll. Threads may ring it without holding Python's lock. The
# constructor raises OSError if no descriptor is left.
class WakeUp:
    def fileno(self) -> int: ...
    def ring(self) -> None: ...

    # Resets the signal.
    def clear(self) -> None: ...

# Reads all ports and processes their samples in one thread; see fltea.service.port_loop.
class Round:
    # `capacity`: as for PortReader. `tick_ns`: time after which a silent port gives a tick. `texts`: number
    # of texts that are printed.
    def __init__(self, capacity: int, tick_ns: int, texts: int) -> None: ...

    # Adds the device on the next port; ports are numbered from 0.
    def add(self, wire: PortDecoder, device: Device, latency_ns: int) -> None: ...

    # As PortReader.add.
    def open(self, port: int, descriptor: int, closes: bool, latency_ns: int) -> None: ...
    def touch(self, port: int, now_ns: int) -> None: ...
    def end(self, port: int) -> None: ...

    # Sets whether rows, printed lines and undecoded bytes of a port are wanted. Rows and bytes may wait up to
    # `patience_ns` for more.
    def wants(self, port: int, rows: bool, text: bool, reads: bool, patience_ns: int) -> None: ...

    # Returns whether rows or bytes of a port wait for more.
    def is_waiting(self, port: int) -> bool: ...

    # Returns the arrival time of the newest processed bytes.
    def now_ns(self, port: int) -> int: ...
    def overflow_bytes(self, port: int) -> int: ...

    # Waits until something is due and processes it. Returns for each text its bytes, and for each device the
    # arrival time of its newest bytes and its number of records; then for each event the port, the kind
    # (`PortStop`) and the data of the event.
    def run(
        self, timeout_s: float
    ) -> tuple[list[tuple[bytes, list[tuple[int, int]]]], list[tuple[int, int, Any]]]: ...

    # Returns the longest time that bytes waited beyond their latency since the last call.
    def waited_ns(self) -> int: ...
    def wake(self) -> None: ...
    def close(self) -> None: ...

# Adds `ns` to all offsets from the monotonic clock to Unix time (for tests).
def shift_unix_clock(ns: int) -> None: ...

# See fltea.wire.ports. `capacity`: most bytes of one port that may wait; each read counts as 24 bytes more.
class PortReader:
    def __init__(self, capacity: int) -> None: ...

    # Starts to read a port. `closes`: an empty read means that the other side has closed the connection.
    # Raises OSError if the descriptor cannot be polled.
    def add(self, port: int, descriptor: int, closes: bool, latency_ns: int) -> None: ...

    # Waits until something is due. Returns the time, and for each port with new data or a loss: its number,
    # bytes, end, host_ns and unix_offset_ns of each read, number of dropped bytes, and, if the port was lost,
    # errno, host_ns and unix_offset_ns of the loss.
    def take(
        self, timeout_s: float
    ) -> tuple[
        int,
        list[
            tuple[
                int,
                bytes,
                tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
                int,
                tuple[int, int, int] | None,
            ]
        ],
    ]: ...
    def wake(self) -> None: ...
    def close(self) -> None: ...

# The items that arrive over one port, given out one by one: see fltea.sources.wire_events. Times are int64.
# `silence_ns`, `tick_ns`: time without bytes after which silence or a tick is reported; `repeat_ns`: least
# time between two reports of the same trouble.
class PortDecoder:
    def __init__(self, silence_ns: int, tick_ns: int, repeat_ns: int) -> None: ...

    # Offset to Unix time of the newest item that `next` has returned.
    unix_offset_ns: int

    # The following methods report what happened to the port. Items that `next` has not returned are dropped.
    def opened(self, host_ns: int, unix_offset_ns: int) -> None: ...

    # Returns whether the failure is to be reported (not a repetition).
    def failed(self, kind: str, host_ns: int, unix_offset_ns: int) -> bool: ...

    # Adds the bytes of successive reads, with ticks where nothing came. Raises ValueError unless the last
    # read ends where the bytes end.
    def feed(
        self,
        data: bytes | bytearray | memoryview,
        end: _Ints,
        host_ns: _Ints,
        unix_offset_ns: _Ints,
        now_ns: int,
    ) -> None: ...

    # Adds the bytes of one read, without ticks before it.
    def feed_one(
        self, data: bytes | bytearray | memoryview, host_ns: int, unix_offset_ns: int, now_ns: int
    ) -> None: ...
    def silent(self, now_ns: int) -> None: ...
    def pass_time(self, until_ns: int) -> None: ...
    def forgive(self, now_ns: int) -> None: ...
    def resume(self, now_ns: int) -> None: ...

    # One of these is called after a HELLO, before the next item: it uses or drops the samples behind the
    # HELLO. refuse_hello returns whether the refusal is to be reported (not a repetition).
    def accept_hello(self) -> None: ...
    def refuse_hello(self) -> bool: ...

    # Returns the next item, with its host_ns; None if there is none. "samples": columns as in RawBlock;
    # "frame": type, sequence, device_us and payload; "refused_version": payload, and whether to report it;
    # "bad": reason and block; "trouble": kind, and number of bytes that could not be read.
    def next(
        self,
    ) -> (
        tuple[Literal["samples"], tuple[_Ints, _Ints, _Ints, _Counts, _Counts, _Counts, _Ints]]
        | tuple[Literal["frame"], int, int, int, int, bytes]
        | tuple[Literal["same_hello"], int]
        | tuple[Literal["refused_version"], int, bytes, bool]
        | tuple[Literal["bad"], int, str, bytes]
        | tuple[Literal["tick"], int]
        | tuple[Literal["trouble"], int, str, int]
        | None
    ): ...

    # Returns the number of bytes, frames, refused frames, openings of the port, and bad blocks by reason.
    def counts(self) -> tuple[int, int, int, int, dict[str, int]]: ...

# Largest absolute value of measurements and inputs; larger ones are refused.
LARGEST_INPUT: float

# Returns the instruction sets that this processor can use, the best first.
def instruction_sets() -> list[str]: ...

# See fltea.estimator.engine, which checks all arguments; this class checks only enough to avoid crashes.
# Arrays are in C order.
class Engine:
    # `settings`: (lanes, fields) float64, from lane_settings.native_table(). `window`: 0 is unlimited.
    def __init__(
        self,
        instruction_set: str,
        joint: bool,
        guard: int,
        compressed: bool,
        accuracy: int,
        window: int,
        settings: NDArray[np.float64],
    ) -> None: ...

    # Processes `y` and `u` (samples, lanes) float64 with `missing` (samples, lanes) uint8, and fills `out`
    # (8, samples, lanes) float64. Raises ValueError for wrong shapes and for refused numbers, before any
    # change of state.
    def run(
        self,
        y: NDArray[np.float64],
        u: NDArray[np.float64] | None,
        missing: NDArray[np.uint8] | None,
        out: NDArray[np.float64],
    ) -> None: ...

    # Sets other settings from the next sample on; the memory is kept.
    def retune(self, settings: NDArray[np.float64]) -> None: ...

    # Resets the lanes that `mask` (lanes,) uint8 marks.
    def reset(self, mask: NDArray[np.uint8]) -> None: ...

    # Fills out (lanes, causes) int32.
    def counts(self, out: NDArray[np.int32]) -> None: ...
    @property
    def storage_bytes(self) -> int: ...

# The supervisor's constants (firmware/core/engine/supervisor.hpp).
LOST_ORDER: float
BOUND_SAMPLES: int
BOUND_MOST: int

# The engine's lanes with the supervisor; see fltea.estimator.lanes. Arguments as for Engine.
class Lanes:
    def __init__(
        self,
        instruction_set: str,
        joint: bool,
        guard: int,
        compressed: bool,
        accuracy: int,
        window: int,
        settings: NDArray[np.float64],
    ) -> None: ...

    # Processes `y` (rows, lanes) float64 with `missing` (rows, lanes) uint8, and fills `out` (7, rows, lanes)
    # float64 and `valid` (rows, lanes) uint8. Returns (row, lane, reason) for each lane that became invalid.
    # Raises ValueError as Engine.run.
    def run(
        self,
        y: NDArray[np.float64],
        missing: NDArray[np.uint8] | None,
        out: NDArray[np.float64],
        valid: NDArray[np.uint8],
    ) -> list[tuple[int, int, Literal["runaway", "bound"]]]: ...
    def restarts(self) -> list[int]: ...

    # Fills out (lanes, causes) int32.
    def counts(self, out: NDArray[np.int32]) -> None: ...

# Largest absolute value of a bias or a sample; larger ones are refused.
LARGEST_OFFSET: float

# Returns mean, variance and whether it is constant, of each column of `y` (rows, columns) float64.
def moments(y: NDArray[np.float64], resolution: float) -> list[tuple[float, float, bool]]: ...

# The filters of all axes of a sensor; see fltea.estimator.bank.
class Bank:
    def __init__(self, axes: int) -> None: ...

    # Processes `y` (rows, axes) float64; fills `out` (7, rows, axes) float64, with the columns of Lanes, and
    # `valid` and `white` (rows, axes) uint8.
    def run(
        self,
        y: NDArray[np.float64],
        out: NDArray[np.float64],
        valid: NDArray[np.uint8],
        white: NDArray[np.uint8],
    ) -> list[tuple[int, int, Literal["runaway", "bound"]]]: ...
    def skip(self, count: int) -> list[tuple[int, int, Literal["runaway", "bound"]]]: ...

    # Returns the `moments` of the samples before `start`: of the start-up window.
    def window(self, resolution: float) -> list[tuple[float, float, bool]]: ...

    # Starts the filters. Arguments as for Lanes, then `bias` (axes,) float64 and `live` (axes,) uint8.
    def start(
        self,
        instruction_set: str,
        joint: bool,
        guard: int,
        compressed: bool,
        accuracy: int,
        window: int,
        settings: NDArray[np.float64],
        bias: NDArray[np.float64],
        live: NDArray[np.uint8],
    ) -> None: ...

    # As Engine.retune.
    def retune(self, settings: NDArray[np.float64]) -> None: ...

    # Sets α and f of an axis (with `joint`: α and β), and their covariance, from the live fit.
    def set_filter_model(
        self,
        axis: int,
        alpha: float,
        parameter: float,
        alpha_variance: float,
        covariance: float,
        parameter_variance: float,
    ) -> None: ...

    # Sets alpha, its standard deviation, f and its standard deviation of each axis, from the live fit. The
    # published deviations of the filters are then not smaller than those.
    def know(self, known: list[tuple[float, float, float, float] | None]) -> None: ...

    # Returns alpha and the filter's own standard deviation after the last row.
    def newest(self, axis: int) -> tuple[float, float]: ...
    def restarts(self) -> list[int]: ...
    def counts(self, out: NDArray[np.int32]) -> None: ...

    # Returns the whiteness of the innovations of each axis: lag 1 and NIS first, NaN while not known.
    def whiteness(self) -> list[tuple[float, float, float, int]]: ...

    # Returns the states of the engine, of the supervisors and of the whiteness tests.
    def save(self) -> tuple[bytes, bytes, bytes]: ...

    # Restores these states. Raises ValueError for bytes that cannot come from `save`.
    def load(
        self, engine: bytes, supervisors: bytes | None, restarts: list[int], whiteness: bytes | None
    ) -> None: ...

# Sums of the overlapping Allan variance of one axis (host/native/allan_sums.hpp).
class AllanSums:
    # `memory_samples`: time constant of forgetting; 0: nothing is forgotten.
    def __init__(self, memory_samples: float = 0.0) -> None: ...

    # Adds `y` (n,) float64. Raises ValueError for refused numbers, before any change.
    def add(self, y: NDArray[np.float64]) -> None: ...

    # Marks a break of `lost` samples; no difference of means spans it.
    def cut(self, lost: int = 0) -> None: ...
    def merge(self, other: AllanSums) -> None: ...

    # Returns averaging factors (samples), Allan variances, and effective numbers of terms.
    def points(self) -> tuple[list[float], list[float], list[float]]: ...

    # Number of samples added, and number of samples that the variances represent.
    @property
    def samples(self) -> float: ...
    @property
    def span(self) -> float: ...
    def save(self) -> bytes: ...

    # Raises ValueError for bytes that cannot come from `save`; nothing has changed then.
    def load(self, bytes: bytes) -> None: ...

# Constants of the running spectrum (host/native/octaves.hpp): memory of a lane in bytes, number of levels,
# number of samples that a level keeps undivided, samples of a block, index of the first frequency bin that is
# used, and number of bins of level 0 and of each level below.
OCTAVES_LANE_BYTES: int
OCTAVES_LEVELS: int
OCTAVES_WHOLE: int
OCTAVES_BLOCK: int
OCTAVES_LOWEST: int
OCTAVES_LINES: tuple[int, int]

# Returns the gains of the half-band filter before decimation by 2, at angular frequencies in rad per sample.
def half_band_gains(angles: _V) -> list[float]: ...

# Returns the begin and end of the most significant peak's bins, and the level around the peak; None if there
# is no peak. See fltea.spectrum.ordinates.
def strongest_octave_peak(power: _V, weight: _V, false_alarm: float) -> tuple[int, int, float] | None: ...

# Most state coordinates of a tracker's system.
TRACKER_COORDINATES: int

# A linear system of the noise, as from System.numbers: number of pole pairs, then a, b, Q, c, the coordinates
# of the state and of the bias, P0, R (fltea.noise.linear_system.System).
_System = tuple[int, _V, _V, _V, _V, _V, _V, _V, float]

# A copy of the samples that a tracker keeps of one axis. Its likelihoods are 2 log L except for a constant.
class Remembered:
    # Returns the likelihood of the system extended by each of these lists of coordinates (Coordinate). It
    # releases Python's lock.
    def likelihoods(
        self, system: _System, coordinates: Sequence[Sequence[tuple[float, float, float, float, float]]]
    ) -> list[float]: ...

    # Returns the likelihood of the tracker's initial random-walk models; NaN before enough samples, and after
    # a system was set.
    def of_walks(self) -> float: ...

# A noise model for the tracker; see fltea.noise.system.
class TrackerModel:
    MOST_TO_COME: int

    # `systems`: one system or two; `weights`: the probability of each.
    def __init__(
        self,
        ahead: int,
        checked: list[int],
        absolute: bool,
        weights: list[float],
        systems: list[_System],
    ) -> None: ...
    # Filters the remembered samples with this model, before it is set; the tracker may take up to `to_come`
    # samples meanwhile.
    def refilter(self, remembered: Remembered, to_come: int) -> None: ...

# Fills in `P` (n, n), the covariance of x after `samples` samples at rest.
def rested(system: _System, samples: int, P: NDArray[np.float64]) -> None: ...

# Predicts the sums of c x and white noise of variance `R` over each number of coming samples in `counts`.
# Returns for each sum the row r of its expectation r x, and the variance of its error given x.
def sums_ahead(
    system: _System, c: _V, R: float, counts: list[int]
) -> tuple[list[list[float]], list[float]]: ...

# Largest relative difference of sequence numbers and device time: twice the tolerance of the sensor's clock.
CLOCK_TOLERANCE: float

# Returns whether a stop (`fltea.stream.decode.Stop`) happens before the next sample; else after the last one.
def stands_before_sample(stop: int) -> bool: ...

# One sensor of a device: whether it is an accelerometer; columns of its axes; tracker; running spectra;
# longest motion [samples]; filters; samples until their start-up window is full; which axes still wait to be
# tuned.
DeviceSensor = tuple[bool, list[int], Tracker, Octaves | None, int, Bank | None, int, list[bool]]

# Processes the samples of one device; see fltea.stream.
class Device:
    stats_due_ns: int
    fit_due: int
    fit_counts: int

    def __init__(self) -> None: ...

    # `scales`: the fields of sample_scaling.Scales.
    def on_hello(
        self,
        rate_hz: float,
        longest_gap: int,
        is_another_boot: bool,
        is_another_sensor: bool,
        scales: tuple[float, float | None, float, float],
    ) -> None: ...
    def forget_hello(self) -> None: ...
    @property
    def knows_hello(self) -> bool: ...
    def on_break(self, reason: str) -> None: ...
    def begin(self, offset_ns: int, sensors: list[DeviceSensor]) -> None: ...
    def set_waits(self, sensor: int, waits: list[bool]) -> None: ...
    def window_left(self, sensor: int) -> int: ...

    # Sets the printers that print all samples processed from now on.
    def set_printers(self, printers: list[RunPrinter]) -> None: ...

    # Processes samples from row `next` on. `raw`: the fields of RawBlock. Returns the reason to stop
    # (`Stop`), the next row, the processed rows (`Rows`), and the data of the stop. Raises ValueError for
    # columns of other types, and for numbers that no filter can process.
    def advance(self, raw: tuple[Any, ...], next: int) -> tuple[int, int, Any, Any]: ...

    # The counts of samples, by their names in SampleStats.
    @property
    def counts(self) -> dict[str, int]: ...
    def note_lost(self, count: int) -> None: ...

    # Sequence, device_us and host_ns of the newest sample as they arrived; its unwrapped number and
    # device_us.
    @property
    def newest(self) -> tuple[int, int, int, int, int]: ...

    # Number, device_us and Unix time of the last processed sample; None before the first.
    @property
    def moment(self) -> tuple[int, int, int] | None: ...
    @property
    def rate_hz(self) -> float | None: ...
    @property
    def clock_ppm(self) -> float | None: ...

# Returns the mean time, the mean delay, the slope and its standard error. See fltea.sources.clock_fit.
def fit_clock(device: Sequence[float], delay: Sequence[float]) -> tuple[float, float, float, float]: ...

# Fits the host's clock to the device's clock.
class Timebase:
    def __init__(self, offset_ns: int) -> None: ...

    # Returns the Unix times of samples, from their arrival times [ns].
    def add(self, seq: list[int], device_us: list[int], host_ns: list[int]) -> list[int]: ...
    @property
    def rate_hz(self) -> float | None: ...
    @property
    def clock_ppm(self) -> float | None: ...

# Tracks the biases of all axes of one sensor.
class Tracker:
    # `offsets`: fixed offset of each axis, or None. Raises ValueError if there are no axes, and for
    # impossible rules.
    def __init__(
        self,
        offsets: list[float | None],
        ahead: int,
        checked: list[int],
        largest_step: float,
        largest_gravity_step: float,
        still: int,
        patience: int,
        settles: bool,
    ) -> None: ...

    # Processes `y` (rows, lanes) with `accel` (rows, 1 to 3); fills `out` (5, rows, lanes): state, state_std,
    # bias, bias_std, innovation; and `moving`, uint8. Returns kind, row, axis, ago, size, size_std and
    # samples of each step and motion.
    def run(
        self,
        y: NDArray[np.float64],
        out: NDArray[np.float64],
        moving: NDArray[np.uint8],
        accel: NDArray[np.float64] | None,
        rest: int,
    ) -> list[tuple[int, int, int, int, float, float, int]]: ...
    def moving(self) -> bool: ...
    def skip(self, count: float) -> None: ...
    def set(self, lane: int, model: TrackerModel) -> None: ...
    def remembered(self, lane: int) -> Remembered: ...
    # Returns the origin of x, and x after the newest sample; x is empty before a system is set.
    def x(self, lane: int) -> tuple[float, list[float]]: ...
    def stats(
        self,
    ) -> list[tuple[int, int, int, float, float, float, int, list[tuple[int, float]], float, float]]: ...
    def save(self) -> bytes: ...
    def load(self, bytes: bytes) -> None: ...

# The running spectra of several axes (lanes); see fltea.spectrum.octaves.
class Octaves:
    # Raises ValueError if there are no lanes, or if `memory` is neither 0 nor 256 to 10^12 samples.
    def __init__(self, lanes: int, memory: float) -> None: ...

    # Adds `y` (rows, lanes) float64. Raises ValueError for a wrong shape, and for numbers that are not finite
    # or too large.
    def add(self, y: NDArray[np.float64]) -> None: ...

    # Adds only the samples at rest; `moving` (rows, lanes) marks the others. Motion that lasts longer than
    # `longest` samples is added from then on.
    def add_at_rest(self, y: NDArray[np.float64], moving: NDArray[np.uint8], longest: float) -> None: ...
    def skip(self, count: float) -> None: ...
    def merge(self, other: Octaves) -> None: ...

    # Returns the numbers of taken, used, bridged and lost samples, gaps, knocks, knocked samples, steps,
    # changes, limited and moved samples, and motions; and whether the axis was always constant.
    def counts(self, lane: int) -> tuple[list[int], bool]: ...

    # Returns the number of steps and changes of all lanes.
    def noticed(self) -> int: ...

    # Returns Welch's sums of each level: power (bins,) float64, blocks, effective blocks; then the samples of
    # the level that is kept undivided, float32, and the lengths of its unbroken segments, int32.
    def spectrum(self, lane: int) -> tuple[list[tuple[bytes, float, float]], bytes, bytes]: ...

    # Returns the number of the next sample, and for each level (cells, 4) float64: first sample, count, mean,
    # squares; and (scales, 2) float64: pairs, variance.
    def cells(self, lane: int) -> tuple[int, list[tuple[bytes, bytes]]]: ...

    # Returns averaging factors (samples), Allan variances, effective numbers of terms, and the number of
    # samples that they represent.
    def allan(self, lane: int) -> tuple[list[float], list[float], list[float], float]: ...
    def copy(self) -> Octaves: ...
    def save(self) -> bytes: ...
    def load(self, bytes: bytes) -> None: ...

# Fits noise models to the bins of one spectrum. A model is a list of `codes`, the numbers of its parts as in
# fltea.noise.parts, and a list `eta` of its free parameters.
class WhittleFits:
    # All arrays are (bins,). `lam`: frequencies; `counts`: effective ordinates; `power`: the spectrum;
    # `walk`: spectrum of a random walk of unit steps; `window`: mean square of the frequency offsets that
    # each bin averages over. `h`: sampling period [s]. Raises ValueError if the bins cannot be fitted.
    def __init__(
        self,
        lam: NDArray[np.float64],
        counts: NDArray[np.float64],
        power: NDArray[np.float64],
        walk: NDArray[np.float64],
        window: NDArray[np.float64],
        h: float,
    ) -> None: ...

    # Returns the best free parameters that are reached from `eta`, and -log L there. `held`: index of a
    # parameter that keeps its value; -1: none. This and the methods below raise ValueError for codes and eta
    # that are no model.
    def fit(
        self,
        codes: list[int],
        eta: list[float],
        held: int = -1,
        steps: int = 60,
        converged: float = 1e-5,
        slowest: float = 1.0,
        lowest_order: float = 0.0,
        highest_order: float = 1.999,
    ) -> tuple[list[float], float]: ...

    # Returns codes, free parameters and -log L of the seven candidate models; without codes where there is
    # none. `last`: candidate models of an earlier search, which are fitted again; may be empty.
    def search(
        self, last: list[tuple[list[int], list[float], float]]
    ) -> list[tuple[list[int], list[float], float]]: ...

    # Returns the likelihood ratios of the test for white noise, against fractional noise with white noise and
    # against white noise through a high-pass, and the free parameters of both models. `last`: those of an
    # earlier test; may be empty.
    def null_test(self, last: list[float]) -> tuple[float, float, list[float]]: ...

    # Returns one end of the likelihood interval of parameter `index`, on the side `side`; NaN if there is
    # none before `limit`; and the differences of all parameters there from `eta`. `usual`: decrease of 2 log
    # L that defines the end; `at_bound`: the same for models without white noise. `last`: differences of an
    # earlier call; may be empty.
    def end(
        self,
        codes: list[int],
        eta: list[float],
        nll: float,
        index: int,
        side: int,
        limit: float,
        step: float,
        usual: float,
        at_bound: float,
        last: list[float],
    ) -> tuple[float, list[float]]: ...

    # Fills in the spectrum `total` (bins,), and `rows` (p, bins), the derivatives of its logarithm by each
    # free parameter.
    def slopes(
        self,
        codes: list[int],
        eta: list[float],
        total: NDArray[np.float64],
        rows: NDArray[np.float64],
    ) -> None: ...

# The table of parts, in the order of their numbers: name, free parameters (what each is, lowest and highest
# value), traits, the question of the verdict to which the part is the answer, and what BIC counts beside the
# free parameters.
def noise_parts() -> list[tuple[str, list[tuple[str, float, float]], list[str], str, int]]: ...

# Number of the mean of m samples, less m.
MEAN_FROM: int

# Fills in the spectrum of a noise model at lam.
def model_spectrum(
    codes: list[int],
    eta: list[float],
    lam: NDArray[np.float64],
    h: float,
    total: NDArray[np.float64],
) -> None: ...

# Reads lines of text from `begin` up to the first line that is no plain row of numbers. Returns where that
# line begins (beyond the end if there is none), the number of lines read, the decimal mark ("\0" until one
# was seen), the indices of the lines that are rows, and their numbers (rows, places). `separator`: "\0" means
# white space. `least`, `most`: as in text_layout.Layout. `places`: indices of the wanted columns.
def plain_rows(
    text: bytes,
    begin: int,
    separator: str,
    least: int,
    most: int,
    places: Sequence[int],
    decimal: str,
) -> tuple[int, int, str, _Ints, _V]: ...

# Prints JSON lines from a template. `texts`: the fixed texts before each hole and after the last one.
# `holes`: (column, index in the column's row) of the number that fills each hole. `nulls`: print numbers that
# are not finite as null, instead of leaving them and their key out.
class Lines:
    def __init__(self, texts: list[bytes], holes: list[tuple[int, int]], nulls: bool) -> None: ...

    # Appends the lines of rows begin, begin + step, … below end to `into`. A column without a hole may be
    # anything.
    def add(self, into: bytearray, columns: list[Any], begin: int, end: int, step: int) -> None: ...

# Prints the samples that a Device processes. `every`: print samples whose number is a multiple of it.
# `weight`: number of records for each sample. `shape`: shape of the rows that fit the lines: number of values
# of the gyroscope, and of the accelerometer or 0; whether there are temperatures and flags; for each sensor
# its number of axes, whether it is the accelerometer, and whether it has estimates. Raises ValueError if a
# hole has no column.
class RunPrinter:
    def __init__(self, lines: Lines, every: int, weight: int, shape: list[int]) -> None: ...

    # Returns the text printed since the last call, its number of records, and the number of rows after it
    # that were not printed, since one of them has another shape.
    def take(self) -> tuple[bytes, int, int]: ...
