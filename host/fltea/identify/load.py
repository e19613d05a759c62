"""Recordings to axes that can be identified: the longest stretch without a missing sample of each.

A spectrum of a series with holes is another one's, so nothing is bridged here. What is left out is counted.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.archive.info import sessions
from fltea.identify.traps import Trap, sensor_traps, source_trap, timing_traps
from fltea.recording.bag_files import bags_in
from fltea.recording.how import AS_IT_SAYS, How
from fltea.recording.kind import is_one_file
from fltea.recording.spool import Spool
from fltea.records.errors import FlteaError, UsageError
from fltea.records.events import Trouble
from fltea.records.records import ACCEL_AXES, AXES, Hello
from fltea.settings.limits import DEFAULT_LIMITS, Limits
from fltea.sources.replay import ReplaySource, open_mcap
from fltea.stream.decode import Decoded, Decoder
from fltea.wire.layout import SampleFlags
from fltea.wire.sample_scaling import accel_resolution_ms2, resolution_dps

Array = NDArray[np.float64]

MAX_GAP = 100
"""Samples, as `link.max_gap`: what it decides is only how a break is counted."""

MOST_TOLD = 5
"""Troubles of the recording itself that are told one by one."""

GYRO_UNIT, ACCEL_UNIT = "deg/s", "m/s²"


class Request(msgspec.Struct, frozen=True):
    """What to read: the files of one recording, and how.

    channels: axes; None for all of the gyroscope's. limits: how much memory it may take.
    """

    paths: tuple[Path, ...]
    channels: tuple[str, ...] | None = None
    how: How = AS_IT_SAYS
    limits: Limits = DEFAULT_LIMITS

    @property
    def name(self) -> str:
        """What to call it: its file, or the session that its files are of."""
        first = self.paths[0]
        return str(first) if len(self.paths) == 1 else str(first.with_name(first.stem.rpartition("_")[0]))


class Counts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the recording holds, and how much of it is used.

    samples: all that arrived. used: of the longest stretch that is unbroken, whose first is number
    `used_from` of all. stretches: pieces between breaks. lost, gaps, duplicates, before_hello: as in `stats`.
    late, retried, saturated: samples of the stretch that the device flagged so.
    """

    samples: int
    used: int
    used_from: int
    stretches: int
    lost: int
    gaps: int
    duplicates: int
    before_hello: int
    late: int
    retried: int
    saturated: int


class Series(NamedTuple):
    """One axis: y (n,) and one LSB, if it is known, in `unit`."""

    y: Array
    unit: str
    lsb: float | None


class Loaded(NamedTuple):
    """One recording. clock_ppm: how much faster the device's clock runs than the host's, None if unknown.

    traps: those of the recording as a whole.
    """

    hello: Hello
    counts: Counts
    axes: dict[str, Series]
    clock_ppm: float | None
    traps: tuple[Trap, ...]

    @property
    def h(self) -> float:
        """Sampling period in s."""
        return 1 / self.hello.rate_hz


class Unreadable(NamedTuple):
    """In place of a recording: where there is none, and why."""

    name: str
    error: FlteaError


def recordings(paths: Sequence[Path]) -> list[tuple[Path, ...] | Unreadable]:
    """The recordings in files, folders and names of sessions, each as the files it is made of."""
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
    """All at once, so that the files of one session are put together, or else one by one."""
    try:
        return [tuple(files) for files in sessions(paths)]
    except FlteaError as error:
        if len(paths) == 1:
            return [Unreadable(str(paths[0]), error)]
    return [found for path in paths for found in _mcap_sessions([path])]


def load(request: Request, folder: Path | None = None) -> Loaded:
    """Read one recording.

    folder: where the samples are kept in files, for as long as they are used; None: in memory.

    Raises:
        UsageError: it cannot be read, holds no samples, or not the axes that are asked for.
    """
    path = request.paths[0]
    if is_one_file(path):
        source = ReplaySource(
            path,
            how=request.how,
            limits=request.limits,
        )
        events, offset = source.events(), lambda: source.unix_offset_ns
    else:
        if request.how.of_text or request.how.topic is not None:
            raise UsageError(
                f"{path}: --columns, --units, --rate and --time-column are for text, --topic for bags of ROS."
            )
        recording = open_mcap(request.paths, f"replay:{request.name}", request.limits)()
        events, offset = recording.events(), lambda: recording.unix_offset_ns
    decoder = Decoder(offset, MAX_GAP)
    longest = now = _Stretch(0, folder)
    stretches = samples = 0
    told: list[Trap] = []
    for event in events:
        if isinstance(event, Trouble):
            told.append(source_trap(event.kind, event.message))
        for found in decoder.feed(event):
            if not isinstance(found, Decoded):
                continue
            if found.missing or found.new_epoch is not None or not now.fits(found):
                now.close(unless=longest)
                now = _Stretch(samples, folder)
                stretches += 1
            samples += len(found.block)
            now.add(found, decoder)
            if len(now) > len(longest):
                longest.close(unless=now)
                longest = now
    if longest.hello is None:
        raise UsageError(f"{request.name}: holds no samples that can be used.")
    c = decoder.place
    lost = c.lost, c.gaps, c.duplicates, c.before_hello
    counts = Counts(samples, len(longest), longest.first, stretches, *lost, *longest.flagged)
    axes, clock_ppm = longest.axes(), None if longest.no_clock else longest.ppm
    traps = _traps(longest, counts, axes, clock_ppm)
    return Loaded(longest.hello, counts, _chosen(axes, request), clock_ppm, (*told[:MOST_TOLD], *traps))


def _traps(
    used: "_Stretch", counts: Counts, axes: dict[str, Series], clock_ppm: float | None
) -> tuple[Trap, ...]:
    assert used.hello is not None
    gyro = [name for name in AXES if name in axes]
    of_time = timing_traps(
        used=counts.used,
        samples=counts.samples,
        lost=counts.lost,
        gaps=counts.gaps,
        stretches=counts.stretches,
        rate_hz=used.hello.rate_hz,
        clock_ppm=clock_ppm,
    )
    # One axis at a time in memory.
    return of_time + sensor_traps(map(used.axis, gyro), [axes[name].lsb for name in gyro])


def _chosen(axes: dict[str, Series], request: Request) -> dict[str, Series]:
    wanted = request.channels or tuple(name for name in axes if name in AXES)
    lacking = [name for name in wanted if name not in axes]
    if lacking:
        raise UsageError(f"{request.name}: has no {', '.join(lacking)} (it has {', '.join(axes)}).")
    return {name: axes[name] for name in wanted}


class _Stretch:
    """Samples that follow each other without a break, all of one rate and scale."""

    def __init__(self, first: int, folder: Path | None) -> None:
        self.first = first
        self.hello: Hello | None = None
        self.ppm: float | None = None
        self.no_clock = True
        self.flagged = [0, 0, 0]
        self._in_files = folder is not None
        self._spool = Spool(folder)
        self._gyro_axes = self._accel_axes = 0
        self._samples = 0

    def __len__(self) -> int:
        return self._samples

    def fits(self, found: Decoded) -> bool:
        """Whether a sample is like those before it."""
        a, b = self.hello, found.hello
        return a is None or (
            (a.rate_hz, a.gyro_lsb_per_dps, a.accel_lsb_per_g)
            == (b.rate_hz, b.gyro_lsb_per_dps, b.accel_lsb_per_g)
            and found.block.gyro_dps.shape[1] == self._gyro_axes
            and (found.block.accel_ms2 is None) == (self._accel_axes == 0)
        )

    def add(self, found: Decoded, decoder: Decoder) -> None:
        """Take the next ones."""
        block = found.block
        if self.hello is None:
            self.hello = found.hello
            self._gyro_axes = block.gyro_dps.shape[1]
            self._accel_axes = 0 if block.accel_ms2 is None else block.accel_ms2.shape[1]
        self._samples += len(block)
        for names, values in ((AXES, block.gyro_dps), (ACCEL_AXES, block.accel_ms2)):
            for name, column in zip(names, () if values is None else values.T, strict=False):
                self._spool.append(name, column)
        if block.flags is not None and block.flags.any():
            for i, flag in enumerate((SampleFlags.LATE, SampleFlags.RETRIED, SampleFlags.SATURATED)):
                self.flagged[i] += int(np.count_nonzero(block.flags & flag))
        # Of a recording without arrival times the device's are given out for them.
        self.no_clock = self.no_clock and bool((found.raw.host_ns == block.device_us * 1000).all())
        if decoder.timebase is not None:
            self.ppm = decoder.timebase.clock_ppm

    def axis(self, name: str) -> Array:
        """One axis in memory, (n,)."""
        return self._spool.whole(name)

    def axes(self) -> dict[str, Series]:
        """All of them by name."""
        assert self.hello is not None
        found = {}
        for names, unit, lsb in (
            (AXES, GYRO_UNIT, resolution_dps(self.hello)),
            (ACCEL_AXES, ACCEL_UNIT, accel_resolution_ms2(self.hello)),
        ):
            for name in names:
                if name in self._spool:
                    y = self._spool.mapped(name) if self._in_files else self._spool.whole(name)
                    found[name] = Series(y, unit, lsb)
        return found

    def close(self, unless: "_Stretch") -> None:
        """Forget the samples, unless they are those of `unless`."""
        if self is not unless:
            self._spool.remove()
