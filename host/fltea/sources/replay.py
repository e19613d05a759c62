"""Replays a recording at full speed or at its recorded speed. The samples come in their order or shuffled."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from fltea.diagnostics.asked import AskedSource
from fltea.diagnostics.finding import Finding, ok
from fltea.recording.bag_files import bags_in
from fltea.recording.changes import Changes, MotionMark, StepMark
from fltea.recording.files import Recording, Stored, listed
from fltea.recording.kind import is_one_file
from fltea.recording.ndjson import EpochMark, Kept
from fltea.recording.opening import Printed, check_options, open_recording
from fltea.recording.reading import Answer
from fltea.recording.sample_numbers import Numbering
from fltea.records import clock
from fltea.records.errors import UsageError
from fltea.records.events import (
    SEQUENCE_WRAP,
    TIME_WRAP_US,
    Break,
    Event,
    RawBlock,
    Trouble,
    host_ns_of,
)
from fltea.records.kinds import FILE_TROUBLES
from fltea.records.records import Hello, Sample
from fltea.records.stats import LinkStats
from fltea.settings.config import Config
from fltea.settings.estimator import BY_DEVICE, EstimatorConfig
from fltea.settings.extras import load
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits
from fltea.sources.opening import Named, need_wire
from fltea.sources.pacing import sleep_until
from fltea.wire.sample_scaling import to_counts

if TYPE_CHECKING:
    from fltea.sources.mcap import McapRecording

AT_ONCE = 8192
"""Largest number of samples that are put into one block."""

MOST_TROUBLES = 3
"""The message about too few samples lists at most this many of the file's troubles."""


class ReplaySource:
    """Yields the events of one recording.

    The events have the recorded times, so a second run gives the same output.

    `path`: path of a file. For MCAP recordings it may also be a folder or the name of a session
    (`sources.mcap.find_sessions`). CSV and NDJSON may come through a pipe, which is then read to its end
    before the replay begins.

    `how`: what the user states about the recording. `startup`: number of samples in the start-up window; a
    recording without a sample after this window is refused. `shuffle`: seed of a random permutation of the
    samples, which makes any noise white; the times keep their order. `realtime`: whether to wait between
    samples for as long as the recorded times say. `limits`: limits of memory for reading files.

    Raises:
        UsageError: the file is missing, damaged or too large; the message names file, line and reason.
    """

    live = False
    has_clock = True

    def __init__(
        self,
        path: Path,
        *,
        how: How = AS_IT_SAYS,
        startup: int = 0,
        shuffle: int | None = None,
        realtime: bool = False,
        limits: Limits = DEFAULT_LIMITS,
    ) -> None:
        self._realtime = self.prompt = realtime
        self._closed = False
        self._mcap: McapRecording | None = None
        self._offset_ns = 0
        self._changes = Changes()
        self.about = self.topic = ""
        self.reading: tuple[Answer, ...] = ()
        self.axes: tuple[str, ...] = ()
        troubles: list[str] = []
        # a file name may contain bytes that are no valid text
        printable = str(path).encode(errors="replace").decode()
        name = f"replay:{printable}" + ("" if shuffle is None else f" (shuffled, seed {shuffle})")
        opened = open_recording(path, how, limits) if is_one_file(path) else None
        if shuffle is not None and not isinstance(opened, Stored):
            raise UsageError(f"{path}: --shuffle works on .npz and CSV recordings, other tables and bags.")
        if isinstance(opened, Printed):
            self._events = _from_ndjson(*opened)
            samples = sum(isinstance(record, Sample) for record in opened.records)
            for record in opened.records:
                if isinstance(record, StepMark | MotionMark):
                    self._changes.count(record)
        elif opened is None:
            check_options(path, "mcap", how)
            open_again = open_mcap([path], name, limits)
            samples, troubles = _count_samples(open_again(), startup + 1)
            self._mcap = open_again()
            self._events = self._mcap.events()
        else:
            self._events = _from_recording(name, opened, shuffle)
            samples = opened.samples
            self._offset_ns, self.about = opened.start_unix_ns, opened.about
            self.topic, self.reading, self.axes = opened.topic, opened.reading, opened.axes
        if samples <= startup and troubles:
            raise UsageError(
                f"{path}: {samples} samples can be read, but the start-up window alone takes {startup}. "
                f"What is wrong with it: {' '.join(troubles[:MOST_TROUBLES])}"
            )
        if samples <= startup:
            raise UsageError(
                f"{path}: {samples} rows, but the start-up window alone takes {startup} and estimates begin "
                "after it. Record for longer, or shorten the window: --startup N."
            )

    @property
    def unread(self) -> list[str]:
        """Texts that say which files of the recording cannot be read, or not completely, and why."""
        return [] if self._mcap is None else self._mcap.unread

    @property
    def changes(self) -> Changes:
        """Counts of bias steps and motions in the recording.

        For MCAP files, only those in the events that were yielded so far.
        """
        return self._changes if self._mcap is None else self._mcap.changes

    @property
    def unix_offset_ns(self) -> int:
        """Offset from the recorder's monotonic clock to Unix time [ns]; 0 if it was not recorded."""
        return self._offset_ns if self._mcap is None else self._mcap.unix_offset_ns

    def events(self) -> Iterator[Event]:
        """Yield the recording's events. This is possible only once."""
        begin_ns: int | None = None
        for event in self._events:
            for part in _paced(event) if self._realtime else (event,):
                host_ns = host_ns_of(part)
                if self._realtime and host_ns is not None:
                    begin_ns = clock.host_ns() - host_ns if begin_ns is None else begin_ns
                    sleep_until(begin_ns + host_ns, lambda: self._closed)
                if self._closed:
                    return
                yield part

    def link_stats(self) -> LinkStats:
        """Return the counts of recorded bytes and frames.

        These counts are 0 unless the recording is in MCAP files, since other recordings contain no bytes from
        a wire.
        """
        return LinkStats() if self._mcap is None else self._mcap.link_stats()

    def close(self) -> None:
        """End the iteration of `events`."""
        self._closed = True


TOGETHER_NS = 5_000_000
"""Samples within this time are yielded together [ns]. At 8 kHz, samples that are yielded one by one would
take longer than real time.
"""


def _paced(event: Event) -> Iterator[Event]:
    """Yield a block of samples as short blocks, and any other event unchanged.

    The samples of a short block are all due at the same time.
    """
    if not isinstance(event, RawBlock):
        yield event
        return
    begins = [0, *(np.flatnonzero(np.diff(event.host_ns // TOGETHER_NS)) + 1).tolist()]
    for begin, end in zip(begins, [*begins[1:], len(event.host_ns)], strict=True):
        yield event.rows(begin, end)


def open_mcap(
    paths: Sequence[Path], name: str, limits: Limits = DEFAULT_LIMITS
) -> Callable[[], "McapRecording"]:
    """Return a function that opens a recording in MCAP files. Each call starts at the recording's beginning.

    Raises:
        UsageError: the library is not installed, `sources.mcap.find_session` finds no single session, or the
            files are bags of ROS.
    """
    if bags := [bag for path in paths for bag in bags_in(path)]:
        names = listed([bag.name for bag in bags])
        raise UsageError(f"{paths[0]}: is a folder of {len(bags)} bags; name one of them: {names}.")
    library = _mcap_library()
    session = library.find_session(paths)
    return lambda: library.McapRecording(session, name, limits)


def mcap_sessions(paths: Sequence[Path]) -> list[list[Path]]:
    """Return one list of files for each MCAP recording, and one list for each file that belongs to none.

    Raises:
        UsageError: `find_sessions` refuses the paths, or the library is not installed.
    """
    sessions, stray = _mcap_library().find_sessions(paths)
    found = [
        [*(part.path for part in session.parts), *(file for file in session.unread if file.exists())]
        for session in sessions
    ]
    return found + [[file] for file in stray]


def _mcap_library() -> ModuleType:
    return load("fltea.sources.mcap", "mcap", "record", "MCAP recordings need")


def _count_samples(recording: "McapRecording", limit: int) -> tuple[int, list[str]]:
    """Return the number of samples in a recording, and the texts of the troubles with its files.

    Counting ends when about `limit` samples were found.
    """
    count, troubles = 0, []
    for event in recording.events():
        if isinstance(event, Trouble) and event.kind in FILE_TROUBLES:
            troubles.append(event.message)
        if isinstance(event, RawBlock):
            count += len(event.sequence)
            if count >= limit:
                break
    return count, troubles


def _from_recording(name: str, recording: Stored, shuffle: int | None) -> Iterator[Event]:
    blocks = recording.blocks() if shuffle is None else _shuffled(recording, shuffle)
    numbering = Numbering(1 / recording.rate_hz, recording.rate_hz)
    first: Recording | None = None
    epoch = 0
    for block in blocks:
        if first is None:
            first = block
            epoch = 0 if block.epoch is None else int(block.epoch[0])
            yield Hello(
                source=name,
                host_ns=0,
                rate_hz=recording.rate_hz,
                sampling_mode="recording",
                gyro_lsb_per_dps=recording.lsb_per_dps,
                accel_lsb_per_g=recording.accel_lsb_per_g,
            )
            for note in recording.notes:
                yield Trouble(note.kind, note.text, 0, fatal=False)
        device_us = np.round((block.device_s - first.device_s[0]) * 1e6).astype(np.int64)
        host_ns = device_us * 1000
        if block.host_s is not None and first.host_s is not None:
            host_ns = np.round((block.host_s - first.host_s[0]) * 1e9).astype(np.int64)
        breaks = np.zeros(len(device_us), dtype=np.bool_)
        sequence = block.seq
        # this happens if another program wrote the .npz file, with times by a sensor's clock
        if sequence is None:
            _, sequence, breaks, _ = numbering.add(block.device_s, breaks)
        if block.epoch is not None:
            breaks |= np.diff(block.epoch, prepend=epoch) != 0
            epoch = int(block.epoch[-1])
        # Accelerations in counts are left out if their scale is unknown. The HELLO would have no scale then,
        # and a HELLO without a scale says that the values are in m/s².
        accel = block.accel if recording.accel_lsb_per_g else block.accel_ms2
        raw = RawBlock(sequence % SEQUENCE_WRAP, device_us % TIME_WRAP_US, host_ns, block.gyro, accel)
        begins = [0, *np.flatnonzero(breaks).tolist()]
        for begin, end in zip(begins, [*begins[1:], len(sequence)], strict=True):
            if begin or end == 0:  # a break before the first sample gives `end == 0`
                yield Break("restart", int(host_ns[begin]))
            if end > begin:
                yield raw.rows(begin, end)


def _shuffled(recording: Stored, seed: int) -> Iterator[Recording]:
    """Yield the values of the samples in random order, which needs memory for all of them."""
    whole = recording.whole()
    order = np.random.default_rng(seed).permutation(len(whole.gyro))
    accel, accel_ms2 = (None if one is None else one[order] for one in (whole.accel, whole.accel_ms2))
    yield whole._replace(gyro=whole.gyro[order], accel=accel, accel_ms2=accel_ms2)


def _from_ndjson(records: list[Kept], cut: str | None) -> Iterator[Event]:
    """Yield the events of a recording that is fltea's own NDJSON output.

    Its sample numbers and times do not wrap around.
    """
    if cut is not None:
        yield Trouble("cut_recording", cut, records[0].host_ns, fatal=False)
    hello: Hello | None = None
    waiting: list[Sample] = []

    def block() -> Iterator[RawBlock]:
        if waiting:
            # there is a HELLO: `read_ndjson` refuses a file with samples before the first HELLO
            assert hello is not None
            yield to_counts(waiting, hello)
            waiting.clear()

    for record in records:
        match record:
            case Sample():
                if len(waiting) == AT_ONCE or (waiting and not _alike(waiting[-1], record)):
                    yield from block()
                waiting.append(record)
            case Hello():
                yield from block()
                hello = record
                yield record
            # The recording also says that an epoch began after a gap. This is not passed on: the replay
            # detects the gap again, by the limit that is set now.
            case EpochMark(reason=reason) if reason != "gap":
                yield from block()
                yield Break(record.reason, record.host_ns)
    yield from block()


def _alike(a: Sample, b: Sample) -> bool:
    """Return whether two samples contain the same kinds of values."""
    return (a.accel_ms2 is None, a.temperature_c is None) == (b.accel_ms2 is None, b.temperature_c is None)


def open_named(named: Named, config: Config) -> ReplaySource:
    """Return the source that replays a recording."""
    path, replay = Path(named.place), config.replay
    if is_one_file(path):
        need_wire(config, config.source or named.place)
    return ReplaySource(
        path,
        how=replay.how,
        startup=0 if config.estimator.estimate_on in BY_DEVICE else _startup(config.estimator),
        shuffle=replay.shuffle,
        realtime=config.pace == "real",
        limits=replay.limits,
    )


def _startup(config: EstimatorConfig) -> int:
    """Return the smallest number of samples that a recording must have.

    The result is 0 if this number depends on the sampling rate, which is not known here.
    """
    return config.startup_needed if isinstance(config.startup, int) else 0


def only_reader_of(named: Named) -> str:
    """Return "", since several sources may read one recording."""
    return ""


def check_source(asked: AskedSource) -> Iterator[Finding]:
    """Yield how the recording can be read. That it can be opened was tried before."""
    path = Path(asked.place)
    text = "a recording that can be read" if is_stored(path) else "a pipe, which can be read only once"
    yield ok("source", f"{path}: {text}")


def is_stored(path: Path) -> bool:
    """Return whether a recording can be read more than once, as a pipe cannot."""
    return path.is_file() or path.is_dir()
