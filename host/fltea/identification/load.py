"""Load recordings as axes: all samples of one rate and scale, and the gaps between them.

The code that uses the samples decides how to treat a gap (`identification.gaps`). If a recording has several
rates or scales, only the samples of the most frequent one are loaded. The samples that are left out are
counted.
"""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.identification.counts import Counts
from fltea.identification.data_checks import DataCheck, source_data_check, timing_data_checks
from fltea.identification.gaps import Gaps, bridge, no_gaps
from fltea.identification.judges import judge
from fltea.recording.bag_files import bags_in
from fltea.recording.kind import is_one_file
from fltea.recording.opening import check_options
from fltea.recording.reading import Answer
from fltea.recording.spool import Spool
from fltea.records.arrays import Array
from fltea.records.errors import FlteaError, UsageError
from fltea.records.events import Trouble
from fltea.records.records import ACCEL_AXES, AXES, Hello
from fltea.records.sensor_kind import ACCELEROMETER, GYROSCOPE, SENSOR_KINDS
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits
from fltea.sources.replay import ReplaySource, mcap_sessions, open_mcap
from fltea.stream.decode import Decoded, Decoder
from fltea.wire.layout import SampleFlags

MAX_GAP = 100
"""Longest gap, in samples, after which the epoch goes on, as the setting `link.max_gap`. Here it affects only
how gaps are counted, and from which part the clock's rate is measured.
"""

MOST_REPORTED = 5
"""Largest number of faults of a recording that are reported."""

MOST_GROUPS = 8
"""The samples of at most this many different rates and scales of a recording are kept.

The samples of each rate and scale have their own temporary files.
"""

GYRO_UNIT, ACCEL_UNIT = GYROSCOPE.text_unit, ACCELEROMETER.text_unit


class Request(msgspec.Struct, frozen=True):
    """The files of one recording, and how to read them.

    Attributes:
        paths: the files of the recording.
        channels: names of the axes; None for all axes of the gyroscope.
        how: how to read the files.
        limits: the memory that reading may take.
        accel: whether to read all axes of the accelerometer, too, if there is one and `channels` is None.
    """

    paths: tuple[Path, ...]
    channels: tuple[str, ...] | None = None
    how: How = AS_IT_SAYS
    limits: Limits = DEFAULT_LIMITS
    accel: bool = False

    @property
    def name(self) -> str:
        """Name of the recording: its file, or the session that its files belong to."""
        first = self.paths[0]
        return str(first) if len(self.paths) == 1 else str(first.with_name(first.stem.rpartition("_")[0]))


class Series(NamedTuple):
    """The samples of one axis, with their unit and gaps.

    `y`: samples (n,). `lsb`: one count, None if not known. `y` and `lsb` are in `unit`.
    """

    y: Array
    unit: str
    lsb: float | None
    gaps: Gaps = no_gaps()


class Loaded(NamedTuple):
    """One recording.

    Attributes:
        hello: the device and its settings.
        counts: what became of the samples.
        axes: the axes by name.
        clock_ppm: how much faster the device's clock runs than the host's; None if not known.
        data checks: findings on the recording as a whole.
        topic: topic of a bag; empty for other files.
        reading: how another program's file was read: answers on unit, rate and the like, with the evidence.
    """

    hello: Hello
    counts: Counts
    axes: dict[str, Series]
    clock_ppm: float | None
    data_checks: tuple[DataCheck, ...]
    topic: str = ""
    reading: tuple[Answer, ...] = ()
    accel: tuple[Array, ...] = ()
    """Samples of each accelerometer axis in m/s².

    The samples are loaded even if the user did not ask for them, since they show motion.

    There are no axes if there is no accelerometer, or if all its samples are constant.
    """

    @property
    def h(self) -> float:
        """Sampling period [s]."""
        return 1 / self.hello.rate_hz


class Unreadable(NamedTuple):
    """A recording that cannot be read, with the reason."""

    name: str
    error: FlteaError


def recordings(paths: Sequence[Path]) -> list[tuple[Path, ...] | Unreadable]:
    """Return the recordings in files, folders and session names, each as a tuple of its files."""
    found: list[tuple[Path, ...] | Unreadable] = []
    paths = [path for one in paths for path in bags_in(one) or [one]]
    mcap = [path for path in paths if not is_one_file(path)]
    for path in paths:
        if is_one_file(path):
            found.append((path,))
        elif path == mcap[0]:
            found += _mcap_sessions(mcap)
    return found


def _mcap_sessions(paths: list[Path]) -> list[tuple[Path, ...] | Unreadable]:
    """Return all sessions.

    If that fails, the files are read one by one, so that only the faulty ones fail.
    """
    try:
        return [tuple(files) for files in mcap_sessions(paths)]
    except FlteaError as error:
        if len(paths) == 1:
            return [Unreadable(str(paths[0]), error)]
    return [found for path in paths for found in _mcap_sessions([path])]


def load(request: Request, folder: Path | None = None) -> Loaded:
    """Read one recording.

    `folder`: folder for temporary files with the samples; None: the samples are kept in memory.

    Raises:
        UsageError: the recording cannot be read, holds no samples, or lacks axes that are asked for.
    """
    path = request.paths[0]
    topic, reading = "", tuple[Answer, ...]()
    gyro_names: tuple[str, ...] = AXES
    if is_one_file(path):
        source = ReplaySource(
            path,
            how=request.how,
            limits=request.limits,
        )
        topic, events, offset = source.topic, source.events(), lambda: source.unix_offset_ns
        reading = source.reading
        if source.axes:
            gyro_names = tuple(f"gyro_{axis}" for axis in source.axes)
    else:
        check_options(path, "mcap", request.how)
        recording = open_mcap(request.paths, f"replay:{request.name}", request.limits)()
        events, offset = recording.events(), lambda: recording.unix_offset_ns
    decoder = Decoder(offset, MAX_GAP)
    groups = _Groups(folder, gyro_names)
    reported: list[DataCheck] = []
    for event in events:
        if isinstance(event, Trouble):
            reported.append(source_data_check(event.kind, event.message))
        for found in decoder.feed(event):
            if isinstance(found, Decoded):
                groups.add(found, decoder)
    c = decoder.counts
    if decoder.contradiction is not None:
        if c.rate_differs > c.delivered:
            raise UsageError(f"{request.name}: {decoder.contradiction}")
        reported.append(source_data_check("rate_differs", decoder.contradiction))
    used = groups.largest()
    if used.hello is None:
        raise UsageError(f"{request.name}: holds no samples that can be used.")
    lost = c.lost, c.gaps, c.duplicates, c.before_hello, c.rate_differs
    gaps = used.gaps()
    bridged = gaps.lost_up_to(bridge(len(used), gaps))
    counts = Counts(groups.samples, len(used), used.first, groups.stretches, bridged, *lost, *used.flagged)
    axes, clock_ppm = used.axes(gaps), used.clock.ppm
    chosen = _chosen(axes, request, reading)
    data_checks = _data_checks(used, counts, axes, clock_ppm, chosen, reading)
    return Loaded(
        used.hello, counts, chosen, clock_ppm, (*_most(reported), *data_checks), topic, reading, _accel(axes)
    )


def _accel(axes: dict[str, Series]) -> tuple[Array, ...]:
    found = tuple(axes[name].y for name in ACCEL_AXES if name in axes)
    # some recorders write zeros for a missing accelerometer
    return found if any(np.ptp(y) > 0 for y in found) else ()


def _most(reported: list[DataCheck]) -> list[DataCheck]:
    """Return the faults to report: all that name a file that was not read, and the first few others."""
    unread = [data_check for data_check in reported if data_check.kind == "unread_file"]
    return (
        unread + [data_check for data_check in reported if data_check.kind != "unread_file"][:MOST_REPORTED]
    )


def _data_checks(
    used: "_Group",
    counts: Counts,
    axes: dict[str, Series],
    clock_ppm: float | None,
    wanted: Collection[str],
    reading: Sequence[Answer] = (),
) -> tuple[DataCheck, ...]:
    """Return the data checks on times and losses, and those that concern axes in `wanted` or all axes."""
    assert used.hello is not None
    of_time = timing_data_checks(counts, used.hello.rate_hz, clock_ppm)
    lsb = {name: one.lsb for name, one in axes.items()}
    found = judge(used.axis, lsb, 1 / used.hello.rate_hz, used.gaps(), reading)
    return *of_time, *(
        data_check for data_check in found if not data_check.axes or set(data_check.axes) & set(wanted)
    )


def _chosen(axes: dict[str, Series], request: Request, reading: Sequence[Answer]) -> dict[str, Series]:
    # An accelerometer that was not asked for is left out if its samples are constant: some recorders write
    # zeros for a missing accelerometer.
    wanted = request.channels or tuple(
        name for name, one in axes.items() if name in AXES or (request.accel and np.ptp(one.y) > 0)
    )
    lacking = [name for name in wanted if name not in axes]
    if lacking:
        why = [f" {one.question}: {one}." for one in reading if one.evidence == "missing"]
        has = f"has no {', '.join(lacking)} (it has {', '.join(axes)})."
        raise UsageError(f"{request.name}: {has}{''.join(why)}")
    return {name: axes[name] for name in wanted}


class _Groups:
    """The samples of a recording, grouped by rate and scale."""

    def __init__(self, folder: Path | None, gyro_names: Sequence[str]) -> None:
        self.samples = self.stretches = 0
        self._folder, self._gyro_names = folder, gyro_names
        self._groups: dict[tuple[object, ...], _Group] = {}
        self._last: _Group | None = None

    def add(self, found: Decoded, decoder: Decoder) -> None:
        """Add the next block of samples."""
        group = self._of(found)
        broken = group is not self._last or found.missing > 0 or found.new_epoch is not None
        self.stretches += broken
        # After a change of rate or scale, or a restart of the sensor, the number of missing samples is not
        # known.
        known = group is self._last and found.new_epoch in (None, "gap")
        missing = found.missing if known else 0
        group.add(found, decoder, missing if broken else None)
        self.samples += len(found.block)
        self._last = group

    def largest(self) -> "_Group":
        """Return the group with the most samples, the first among equals, and drop the others."""
        largest = max(self._groups.values(), key=len, default=_Group(0, None, ()))
        for group in self._groups.values():
            if group is not largest:
                group.close()
        return largest

    def _of(self, found: Decoded) -> "_Group":
        block, hello = found.block, found.hello
        accel_axes = 0 if block.accel_ms2 is None else block.accel_ms2.shape[1]
        key = (
            hello.device_id,
            hello.sensor,
            hello.rate_hz,
            hello.gyro_lsb_per_dps,
            hello.accel_lsb_per_g,
            block.gyro_dps.shape[1],
            accel_axes,
        )
        if key not in self._groups:
            if len(self._groups) == MOST_GROUPS:
                self._groups.pop(min(self._groups, key=lambda one: len(self._groups[one]))).close()
            self._groups[key] = _Group(self.samples, self._folder, self._gyro_names)
        return self._groups[key]


class _ClockRate:
    """How much faster the device's clock runs than the host's, in the longest part without a restart."""

    def __init__(self) -> None:
        self._ppm: float | None = None
        self._has_arrivals = False
        self._epoch = self._of_epoch = self._most_of_epoch = 0

    @property
    def ppm(self) -> float | None:
        """How much faster the device's clock runs than the host's [ppm]; None if it is not known."""
        return self._ppm if self._has_arrivals else None

    def add(self, found: Decoded, decoder: Decoder) -> None:
        """Take the next block of samples."""
        samples = len(found.block)
        # If a recording has no arrival times, the device's times are used in their place.
        if not self._has_arrivals:
            self._has_arrivals = bool((found.raw.host_ns != found.block.device_us * 1000).any())
        self._of_epoch = self._of_epoch + samples if decoder.epoch == self._epoch else samples
        self._epoch = decoder.epoch
        if self._of_epoch > self._most_of_epoch:
            self._most_of_epoch, self._ppm = self._of_epoch, decoder.native.clock_ppm


class _Group:
    """The samples of one rate and scale, and the breaks between them."""

    def __init__(self, first: int, folder: Path | None, gyro_names: Sequence[str]) -> None:
        self.first, self._gyro_names = first, gyro_names
        self.hello: Hello | None = None
        self.clock = _ClockRate()
        self.flagged = [0, 0, 0]
        self._in_files = folder is not None
        self._spool = Spool(folder)
        self._samples = 0
        self._at: list[int] = []
        self._missing: list[int] = []

    def __len__(self) -> int:
        return self._samples

    def gaps(self) -> Gaps:
        return Gaps(np.array(self._at, dtype=np.int64), np.array(self._missing, dtype=np.int64))

    def add(self, found: Decoded, decoder: Decoder, missing: int | None) -> None:
        """Add the next block of samples.

        `missing`: what was lost before this block. None: nothing. 0: samples were lost, but their number is
        not known. Otherwise: the number of lost samples.
        """
        block = found.block
        if self.hello is None:
            self.hello = found.hello
        elif missing is not None:
            self._at.append(self._samples)
            self._missing.append(missing)
        self._samples += len(block)
        for kind in SENSOR_KINDS:
            values = getattr(block, kind.samples_field)
            names = self._gyro_names if kind is GYROSCOPE else kind.axes
            for name, column in zip(names, () if values is None else values.T, strict=False):
                self._spool.append(name, column)
        if block.flags is not None and block.flags.any():
            for i, flag in enumerate((SampleFlags.LATE, SampleFlags.RETRIED, SampleFlags.SATURATED)):
                self.flagged[i] += int(np.count_nonzero(block.flags & flag))
        self.clock.add(found, decoder)

    def axis(self, name: str) -> Array:
        """Return one axis as an array in memory, (n,)."""
        return self._spool.whole(name)

    def axes(self, gaps: Gaps) -> dict[str, Series]:
        """Return all axes by name."""
        assert self.hello is not None
        found = {}
        for kind in SENSOR_KINDS:
            for name in kind.axes:
                if name in self._spool:
                    y = self._spool.mapped(name) if self._in_files else self._spool.whole(name)
                    found[name] = Series(y, kind.text_unit, kind.resolution(self.hello), gaps)
        return found

    def close(self) -> None:
        """Drop the samples and their temporary files."""
        self._spool.remove()
