"""Native parts of fltea.

The device's encoder (firmware/core), for tests; the decoder of the wire; the estimator engine; fits of
spectra.
"""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

_V = NDArray[np.float64]
_Ints = NDArray[np.int64]
_Counts = NDArray[np.int16]

SCHEMA_HASH: int

# Of all that the module was built from: host/native/source_hash.py.
SOURCE_HASH: str

def crc32(data: bytes) -> int: ...
def cobs_encode(data: bytes) -> bytes: ...

# ValueError if the payload is too long.
def encode_frame(type: int, sequence: int, device_us: int, payload: bytes) -> bytes: ...

# ValueError if a value does not fit its field.
def encode_message(type: int, sequence: int, device_us: int, fields: tuple[Any, ...]) -> bytes: ...

# Seven int64 a record of an unpacked MCAP chunk: kind, begin, end, channel, sequence, log_time, publish_time;
# the last four are 0 for all but messages. ValueError if a record runs beyond the end.
def chunk_records(chunk: bytes) -> bytes: ...

# The chunks of one MCAP file; compression: MCAP's name of how `end` packs them. ValueError for reads that do
# not follow one another, and where lines and times are not as many.
class McapChunks:
    def __init__(self, compression: str) -> None: ...

    # Bytes of the records in the chunk in progress.
    @property
    def size(self) -> int: ...

    # A record that is no message, as it is.
    def add_record(self, record: bytes) -> None: ...
    def add_message(self, channel: int, sequence: int, log_ns: int, publish_ns: int, data: bytes) -> None: ...

    # A message a read: where each ends in the data, and its times.
    def add_reads(
        self,
        channel: int,
        sequence: int,
        data: bytes,
        end: _Ints,
        log_ns: _Ints,
        publish_ns: _Ints,
    ) -> None: ...

    # A message a line, without its end.
    def add_lines(self, channel: int, log_ns: _Ints, lines: bytes) -> None: ...

    # Ends the chunk: what the file has of it from byte `at` on, with its index; nothing without a message.
    def end(self, at: int, packed: Callable[[bytes], bytes]) -> bytes: ...

    # Of all chunks that have ended: the records of their index, first and last log time, how many they are,
    # and how many messages there are by channel.
    def summary(self) -> tuple[bytes, int, int, int, dict[int, int]]: ...

# See fltea.wire.block_reader.
class Decoder:
    def __init__(self) -> None: ...

    # What ends in these bytes. First n samples as columns: sequence, device_us, gyro (n, 3), accel (n, 3),
    # temperature, flags, end; None instead of empty ones. Then all else in order: samples before it, end,
    # reason (None for an intact frame), type, sequence, device_us (all 0 if there is a reason), payload or
    # block. TypeError if data is not bytes-like, BufferError if its bytes do not follow each other.
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

    # As after a port was closed and opened again.
    def reset(self) -> None: ...
    @property
    def pending(self) -> int: ...

# What a thread waits for with select.poll, and is rung by who need not have Python's lock. OSError: no
# descriptor is left.
class WakeUp:
    def fileno(self) -> int: ...
    def ring(self) -> None: ...

    # From now on it has not been rung.
    def clear(self) -> None: ...

class Round:
    # capacity: as of PortReader. tick_ns: after which a silent line is looked at. texts: so many are printed.
    def __init__(self, capacity: int, tick_ns: int, texts: int) -> None: ...

    # The device on the next port, from 0.
    def add(self, wire: WireLine, device: Device, latency_ns: int) -> None: ...

    # As PortReader.add.
    def open(self, port: int, descriptor: int, closes: bool, latency_ns: int) -> None: ...
    def touch(self, port: int, now_ns: int) -> None: ...
    def end(self, port: int) -> None: ...

    # Whether somebody takes rows, printed lines, and bytes as they came; rows and bytes wait for more.
    def wants(self, port: int, rows: bool, text: bool, reads: bool, patience_ns: int) -> None: ...

    # Whether rows or bytes of a port wait for more.
    def is_waiting(self, port: int) -> bool: ...

    # When the newest of what was taken arrived.
    def now_ns(self, port: int) -> int: ...
    def overflow_bytes(self, port: int) -> int: ...

    # Waits until something is due and takes it. Of each text bytes, and of each device when its
    # newest bytes arrived and how many records are its; and port, kind (`PortStop`) and what is told of what
    # has happened.
    def run(
        self, timeout_s: float
    ) -> tuple[list[tuple[bytes, list[tuple[int, int]]]], list[tuple[int, int, Any]]]: ...

    # The longest that bytes have waited beyond their latency, since this was asked last.
    def waited_ns(self) -> int: ...
    def wake(self) -> None: ...
    def close(self) -> None: ...

# Is added to what the system says of the difference from the monotonic clock to Unix time.
def shift_unix_clock(ns: int) -> None: ...

# See fltea.wire.ports. capacity: bytes that may wait of one port, 24 of each read included.
class PortReader:
    def __init__(self, capacity: int) -> None: ...

    # OSError if the descriptor cannot be waited for. closes: an empty read means that the other side closed.
    def add(self, port: int, descriptor: int, closes: bool, latency_ns: int) -> None: ...

    # Waits until something is due; the time, and for each port with news: its number,
    # bytes, of each read end, host_ns and unix_offset_ns, bytes thrown away, and errno, host_ns and
    # unix_offset_ns of its loss.
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

# What came over one wire, one by one: see fltea.sources.wire_events. Times are int64; silence_ns, tick_ns and
# repeat_ns: after how long a silence, a tick, and the same trouble again are told.
class WireLine:
    def __init__(self, silence_ns: int, tick_ns: int, repeat_ns: int) -> None: ...

    # Of what was given last, as far as it was handed on.
    unix_offset_ns: int

    # These say what happened. What was not taken of what happened before is left out.
    def opened(self, host_ns: int, unix_offset_ns: int) -> None: ...

    # Whether it is news.
    def failed(self, kind: str, host_ns: int, unix_offset_ns: int) -> bool: ...

    # Bytes of successive reads, with ticks where nothing came. ValueError unless they end where the bytes do.
    def feed(
        self,
        data: bytes | bytearray | memoryview,
        end: _Ints,
        host_ns: _Ints,
        unix_offset_ns: _Ints,
        now_ns: int,
    ) -> None: ...

    # Bytes of one read, without ticks before it.
    def feed_one(
        self, data: bytes | bytearray | memoryview, host_ns: int, unix_offset_ns: int, now_ns: int
    ) -> None: ...
    def silent(self, now_ns: int) -> None: ...
    def pass_time(self, until_ns: int) -> None: ...
    def forgive(self, now_ns: int) -> None: ...
    def resume(self, now_ns: int) -> None: ...

    # After a HELLO, before the next item: what becomes of what stands behind it. Whether a refusal is news.
    def accept_hello(self) -> None: ...
    def refuse_hello(self) -> bool: ...

    # The next item, with its host_ns: columns as of RawBlock; type, sequence, device_us and payload; payload
    # and whether it is news; reason and block; kind and bytes that could not be read. None: no more.
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

    # Bytes, frames, refused frames, times that the port was opened, and bad blocks by reason.
    def counts(self) -> tuple[int, int, int, int, dict[str, int]]: ...

# Measurements and inputs beyond ± this are refused.
LARGEST_INPUT: float

# Usable on this processor, best first.
def instruction_sets() -> list[str]: ...

# See fltea.estimator.engine, which checks what this class only guards against crashes. Arrays are in C order.
class Engine:
    # settings: (lanes, fields) float64, lane_settings.native_table(); window 0 is unlimited.
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

    # y, u (samples, lanes) float64; missing (samples, lanes) uint8; fills out (8, samples, lanes) float64.
    # ValueError for wrong shapes and for numbers that are refused, before anything has changed.
    def run(
        self,
        y: NDArray[np.float64],
        u: NDArray[np.float64] | None,
        missing: NDArray[np.uint8] | None,
        out: NDArray[np.float64],
    ) -> None: ...

    # Other settings from the next sample on; the memory stays.
    def retune(self, settings: NDArray[np.float64]) -> None: ...

    # mask (lanes,) uint8
    def reset(self, mask: NDArray[np.uint8]) -> None: ...

    # Fills out (lanes, causes) int32.
    def counts(self, out: NDArray[np.int32]) -> None: ...
    @property
    def storage_bytes(self) -> int: ...

# The supervisor's constants (firmware/core/engine/supervisor.hpp).
LOST_ORDER: float
BOUND_SAMPLES: int
BOUND_MOST: int

# Lanes under the supervisor; see fltea.estimator.lanes. Arguments as those of Engine.
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

    # y (rows, lanes) float64, missing (rows, lanes) uint8; fills out (7, rows, lanes) float64 and valid
    # (rows, lanes) uint8; returns (row, lane, reason) of what became invalid. ValueError as of Engine.run.
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

# A bias beyond ± this, and a sample, is refused.
LARGEST_OFFSET: float

# Mean, variance and constancy of each column of y (rows, columns) float64, as a bank finds them.
def moments(y: NDArray[np.float64], resolution: float) -> list[tuple[float, float, bool]]: ...

# All axes of a sensor; see fltea.estimator.bank.
class Bank:
    def __init__(self, axes: int) -> None: ...

    # y (rows, axes) float64; fills out (7, rows, axes) float64, the columns of Lanes, and valid and white
    # (rows, axes) uint8.
    def run(
        self,
        y: NDArray[np.float64],
        out: NDArray[np.float64],
        valid: NDArray[np.uint8],
        white: NDArray[np.uint8],
    ) -> list[tuple[int, int, Literal["runaway", "bound"]]]: ...
    def skip(self, count: int) -> list[tuple[int, int, Literal["runaway", "bound"]]]: ...

    # `moments` of what came until `start`.
    def window(self, resolution: float) -> list[tuple[float, float, bool]]: ...

    # Arguments as of Lanes, then bias (axes,) float64 and live (axes,) uint8.
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

    # An axis goes on with α and f (`joint`: α and β), which have such variances.
    def believe(
        self,
        axis: int,
        alpha: float,
        parameter: float,
        alpha_variance: float,
        covariance: float,
        parameter_variance: float,
    ) -> None: ...

    # Of each axis alpha, its deviation, f and its deviation, of which the filters' own cannot be less sure.
    def know(self, known: list[tuple[float, float, float, float] | None]) -> None: ...

    # alpha and the filter's own deviation after the last row.
    def newest(self, axis: int) -> tuple[float, float]: ...
    def restarts(self) -> list[int]: ...
    def counts(self, out: NDArray[np.int32]) -> None: ...

    # (lag 1, NIS) of each axis, NaN while not known.
    def whiteness(self) -> list[tuple[float, float, float, int]]: ...

    # Engine, supervisors, whiteness.
    def save(self) -> tuple[bytes, bytes, bytes]: ...

    # ValueError for bytes that cannot come from `save`.
    def load(
        self, engine: bytes, supervisors: bytes | None, restarts: list[int], whiteness: bytes | None
    ) -> None: ...

# Sums of the overlapping Allan variance of one axis (host/native/allan_sums.hpp).
class AllanSums:
    # memory_samples: time constant of forgetting, 0 for none.
    def __init__(self, memory_samples: float = 0.0) -> None: ...

    # y (n,) float64. ValueError for numbers that are refused, before anything has changed.
    def add(self, y: NDArray[np.float64]) -> None: ...

    # A break, of so many lost samples: no term reaches across it.
    def cut(self, lost: int = 0) -> None: ...
    def merge(self, other: AllanSums) -> None: ...

    # Averaging factors (samples), Allan variances, effective numbers of terms.
    def points(self) -> tuple[list[float], list[float], list[float]]: ...

    # That were taken, and as many of them as the figures are of.
    @property
    def samples(self) -> float: ...
    @property
    def span(self) -> float: ...
    def save(self) -> bytes: ...

    # ValueError for bytes that cannot come from `save`; then nothing has changed.
    def load(self, bytes: bytes) -> None: ...

# Of the running spectrum (host/native/octaves.hpp): memory of a lane, levels, samples that a level keeps
# whole, samples of a block, its first line, lines of level 0 and of those below.
OCTAVES_LANE_BYTES: int
OCTAVES_LEVELS: int
OCTAVES_WHOLE: int
OCTAVES_BLOCK: int
OCTAVES_LOWEST: int
OCTAVES_LINES: tuple[int, int]

# Of the filter before every second sample is left out, at so many rad a sample.
def half_band_gains(angles: _V) -> list[float]: ...

# The most striking stretch of lines, its end, and the level around it; see fltea.spectrum.octave_lines.
def strongest_octave_peak(power: _V, weight: _V, false_alarm: float) -> tuple[int, int, float] | None: ...

# The running spectra of several lanes; see fltea.spectrum.octaves.
TRACKER_COORDINATES: int

# Systems: pairs, then a, b, Q, c, the state's and the bias's coordinates, P0, R (fltea.noise.system.System).

# What a lane of a tracker remembers, as it was; 2 log L of it, but for a constant.
# A system of noise, as of System.numbers.
_System = tuple[int, _V, _V, _V, _V, _V, _V, _V, float]

class Remembered:
    # Of the system with each of these coordinates, as of Coordinate; Python's lock is free meanwhile.
    def likelihoods(
        self, system: _System, coordinates: Sequence[Sequence[tuple[float, float, float, float, float]]]
    ) -> list[float]: ...

    # NaN while it had seen too little, and once a system was set.
    def of_walks(self) -> float: ...

class TrackerModel:
    MOST_TO_COME: int

    # One system or two, with how likely each is.
    def __init__(
        self,
        ahead: int,
        checked: list[int],
        absolute: bool,
        weights: list[float],
        systems: list[_System],
    ) -> None: ...
    def refilter(self, remembered: Remembered, to_come: int) -> None: ...

# P (n, n) of x after so many samples at rest.
def rested(system: _System, samples: int, P: NDArray[np.float64]) -> None: ...

# Of each number of samples to come: what x has of the sum of c x and white noise, and the variance of what
# comes on top.
def sums_ahead(
    system: _System, c: _V, R: float, counts: list[int]
) -> tuple[list[list[float]], list[float]]: ...

# Whether the axes are the accelerometer's, their columns, what takes the samples (sums, and samples of the
# longest motion; estimates), and which axes wait to be settled.
CLOCK_TOLERANCE: float

# Whether a stop of the device (`fltea.stream.decode.Stop`) is before the next sample, not after the last one.
def stands_before_sample(stop: int) -> bool: ...

# Is an accelerometer; columns of its axes; tracker; sums; the longest motion [samples]; filters; samples
# until their start-up window is full; axes that are not settled.
DeviceSensor = tuple[bool, list[int], Tracker, Octaves | None, int, Bank | None, int, list[bool]]

class Device:
    stats_due_ns: int
    fit_due: int
    fit_counts: int

    def __init__(self) -> None: ...

    # scales: as of Scales.
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

    # These print what is taken from now on.
    def set_printers(self, printers: list[RunPrinter]) -> None: ...

    # raw: as of RawBlock. Why it stopped (`Stop`), which sample comes next, what was taken (`Rows`), and what
    # is told. ValueError for columns of other types, and for numbers that no filter can work with.
    def advance(self, raw: tuple[Any, ...], next: int) -> tuple[int, int, Any, Any]: ...

    # Delivered, lost, gaps, duplicates, before HELLO.
    @property
    def counts(self) -> tuple[int, int, int, int, int]: ...
    def note_lost(self, count: int) -> None: ...

    # Sequence, device_us and host_ns as they came; number and device_us in the epoch.
    @property
    def newest(self) -> tuple[int, int, int, int, int]: ...

    # Number, device_us and Unix time of the last sample that was given out; None before the first.
    @property
    def moment(self) -> tuple[int, int, int] | None: ...
    @property
    def rate_hz(self) -> float | None: ...
    @property
    def clock_ppm(self) -> float | None: ...

class Timebase:
    def __init__(self, offset_ns: int) -> None: ...

    # Unix times of samples, by their arrivals [ns].
    def add(self, seq: list[int], device_us: list[int], host_ns: list[int]) -> list[int]: ...
    @property
    def rate_hz(self) -> float | None: ...
    @property
    def clock_ppm(self) -> float | None: ...

class Tracker:
    # ValueError for no lanes, and for rules that are none.
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

    # y (rows, lanes); out (5, rows, lanes): state, state_std, bias, bias_std, innovation; moving uint8; accel
    # (rows, 1 to 3). Returns kind, row, axis, ago, size, size_std and samples of what has happened.
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
    # The origin of its numbers, and x after the newest sample; no coordinates before a system is set.
    def x(self, lane: int) -> tuple[float, list[float]]: ...
    def stats(
        self,
    ) -> list[tuple[int, int, int, float, float, float, int, list[tuple[int, float]], float, float]]: ...
    def save(self) -> bytes: ...
    def load(self, bytes: bytes) -> None: ...

class Octaves:
    # ValueError for no lanes, and for a memory that is neither 0 nor 256 to 10^12 samples.
    def __init__(self, lanes: int, memory: float) -> None: ...

    # y (rows, lanes) float64. ValueError for a wrong shape, and for numbers that are not finite or too large.
    def add(self, y: NDArray[np.float64]) -> None: ...

    # The same of samples at rest; moving (rows, lanes): which are not. What goes on for more than `longest`
    # samples is taken from there on.
    def add_at_rest(self, y: NDArray[np.float64], moving: NDArray[np.uint8], longest: float) -> None: ...
    def skip(self, count: float) -> None: ...
    def merge(self, other: Octaves) -> None: ...

    # taken, used, bridged, lost, gaps, knocks, knocked, steps, changes, limited, moved, motions; whether
    # it never changed.
    def counts(self, lane: int) -> tuple[list[int], bool]: ...

    # Steps and changes of all lanes.
    def noticed(self) -> int: ...

    # Of each level of Welch's sums: power (lines,) float64, blocks, effective blocks; then the values of the
    # whole level, float32, and the lengths of its stretches, int32.
    def spectrum(self, lane: int) -> tuple[list[tuple[bytes, float, float]], bytes, bytes]: ...

    # Number of the next sample, and of each level (cells, 4) float64: first sample, count, mean, squares; and
    # (scales, 2) float64: pairs, variance.
    def cells(self, lane: int) -> tuple[int, list[tuple[bytes, bytes]]]: ...

    # Averaging factors (samples), Allan variances, effective numbers of terms; of how many samples they are.
    def allan(self, lane: int) -> tuple[list[float], list[float], list[float], float]: ...
    def copy(self) -> Octaves: ...
    def save(self) -> bytes: ...
    def load(self, bytes: bytes) -> None: ...

# Fits of sentences of noise to the bins of one spectrum; parts are numbers, as in fltea.noise.parts.
class Sentences:
    # lam, counts, power, walk, the spectrum of a walk of unit steps, and window, the mean square of the
    # frequencies that a line sees around its own: (bins,). ValueError for what cannot be fitted.
    def __init__(
        self,
        lam: NDArray[np.float64],
        counts: NDArray[np.float64],
        power: NDArray[np.float64],
        walk: NDArray[np.float64],
        window: NDArray[np.float64],
        h: float,
    ) -> None: ...

    # The best coordinates that are reached from eta, and -log L there. held: number of the one that keeps its
    # value. ValueError, here and below, for codes and eta that are no sentence.
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

    # Codes, coordinates and -log L of the seven sentences of a frontier; no codes: there is none. last: those
    # of an earlier search, which are fitted again, or nothing.
    def search(
        self, last: list[tuple[list[int], list[float], float]]
    ) -> list[tuple[list[int], list[float], float]]: ...

    # The null test's ratios, of an order in white noise and of white noise through a high-pass, and the
    # coordinates of both; last: those of an earlier test, or nothing.
    def null_test(self, last: list[float]) -> tuple[float, float, list[float]]: ...

    # The end of an interval to one side, NaN if there is none before the limit, and by how much the
    # coordinates there differ from eta. usual, at_bound: the fall of 2 log L there, and where there is no
    # white noise. last: these differences of an earlier look, or nothing.
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

    # Fills in the spectrum (bins,) and the slopes (p, bins) of its logarithm.
    def slopes(
        self,
        codes: list[int],
        eta: list[float],
        total: NDArray[np.float64],
        rows: NDArray[np.float64],
    ) -> None: ...

# The table of parts, in the order of their numbers: name, coordinates (what each is, lowest and highest
# value), traits, the question of the verdict to which the part is the answer, and what BIC counts beside the
# coordinates.
def noise_parts() -> list[tuple[str, list[tuple[str, float, float]], list[str], str, int]]: ...

# Number of the mean of m samples, less m.
MEAN_FROM: int

# Fills in the spectrum of a sentence at lam.
def sentence_spectrum(
    codes: list[int],
    eta: list[float],
    lam: NDArray[np.float64],
    h: float,
    total: NDArray[np.float64],
) -> None: ...

# Lines of text from `begin` up to the first that is no plain row of numbers: where it begins (beyond the
# end if there is none), how many lines are passed, the mark of decimals ("\0" as long as none was seen),
# which of the lines are rows, and (rows, places) numbers. separator "\0": white space. least, most: as of
# text_layout.Layout.
def plain_rows(
    text: bytes,
    begin: int,
    separator: str,
    least: int,
    most: int,
    places: Sequence[int],
    decimal: str,
) -> tuple[int, int, str, _Ints, _V]: ...

# Lines of JSON: texts stand before each hole and after the last one, holes are (column, place in its row);
# nulls: numbers that are not finite are null, else left out with their key.
class Lines:
    def __init__(self, texts: list[bytes], holes: list[tuple[int, int]], nulls: bool) -> None: ...

    # Adds rows begin, begin + step, … below end; a column without a hole may be anything.
    def add(self, into: bytearray, columns: list[Any], begin: int, end: int, step: int) -> None: ...

# Prints what a Device takes. every: samples whose number is a multiple of it; weight: records that each
# stands for. shape: which rows the lines are of. Numbers a row of the gyroscope, and of the accelerometer or
# 0; whether there are temperatures and flags; of each sensor its axes, whether it is the accelerometer, and
# whether it has estimates. ValueError if there are holes without a column.
class RunPrinter:
    def __init__(self, lines: Lines, every: int, weight: int, shape: list[int]) -> None: ...

    # Since the last call: what was printed, how many records it stands for, and how many rows behind it were
    # not printed, since they or one before them have another shape.
    def take(self) -> tuple[bytes, int, int]: ...
