"""A recording as a source: as fast as it can, or at its own pace; in its order, or shuffled."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fltea import clock
from fltea.continuity import SEQUENCE_WRAP, TIME_WRAP_US
from fltea.errors import UsageError
from fltea.model import Break, DeviceStatus, Epoch, Event, Hello, LinkStats, RawSample, Sample, Trouble
from fltea.sources.pacing import sleep_until
from fltea.sources.recording import Recording, read_csv, read_npz
from fltea.sources.recording_ndjson import read_ndjson
from fltea.units import to_counts


class ReplaySource:
    """Events of one file. Its times are the recording's, so a second run gives the same output.

    startup: samples that the start-up window needs; a shorter recording is refused.
    shuffle: seed of a permutation of the samples (times stay), which makes any noise white.
    realtime: wait between samples as long as the recording did.

    Raises:
        UsageError: a missing or bad file; the text names file, line and reason.
    """

    live = False
    unix_offset_ns = 0

    def __init__(
        self,
        path: Path,
        *,
        columns: list[str] | None = None,
        units: str | None = None,
        rate_hz: float | None = None,
        startup: int = 0,
        shuffle: int | None = None,
        realtime: bool = False,
    ) -> None:
        if not path.is_file():
            raise UsageError(f"{path}: there is no such file.")
        self._realtime = self.prompt = realtime
        self._closed = False
        printable = str(path).encode(errors="replace").decode()  # a name may hold bytes that are no text
        name = f"replay:{printable}" + ("" if shuffle is None else f" (shuffled, seed {shuffle})")
        suffix = path.suffix.lower()
        if suffix in (".ndjson", ".jsonl"):
            records, cut = read_ndjson(path)
            self._events = _from_ndjson(records, cut)
            samples = sum(isinstance(record, Sample) for record in records)
            if shuffle is not None:
                raise UsageError(f"{path}: --shuffle works on .npz and CSV recordings.")
        elif suffix in (".npz", ".csv", ".txt"):
            is_npz = suffix == ".npz"
            recording = read_npz(path) if is_npz else read_csv(path, columns, units or "dps", rate_hz)
            self._events = _from_recording(name, recording, shuffle)
            samples = len(recording.gyro)
        else:
            raise UsageError(f"{path}: the kind is not known by its ending; .npz, .csv or .ndjson is needed.")
        if suffix not in (".csv", ".txt") and (columns or units or rate_hz):
            raise UsageError(
                f"{path}: --columns, --units and --rate are for CSV files; this one names its own."
            )
        if samples <= startup:
            raise UsageError(
                f"{path}: {samples} rows, but the start-up window alone takes {startup} and estimates begin "
                "after it. Record for longer, or shorten the window: --startup N."
            )

    def events(self) -> Iterator[Event]:
        """Yield the recording's events, once."""
        begin_ns: int | None = None
        for event in self._events:
            if self._realtime and not isinstance(event, DeviceStatus):
                begin_ns = clock.host_ns() - event.host_ns if begin_ns is None else begin_ns
                sleep_until(begin_ns + event.host_ns, lambda: self._closed)
            if self._closed:
                return
            yield event

    def link_stats(self) -> LinkStats:
        """Nothing can get lost between a file and here."""
        return LinkStats()

    def close(self) -> None:
        """End the iteration."""
        self._closed = True


def _from_recording(name: str, recording: Recording, shuffle: int | None) -> Iterator[Event]:
    n = len(recording.gyro)
    order = np.arange(n) if shuffle is None else np.random.default_rng(shuffle).permutation(n)
    device_us = np.round((recording.device_s - recording.device_s[0]) * 1e6).astype(np.int64)
    host_ns = device_us * 1000
    if recording.host_s is not None:
        host_ns = np.round((recording.host_s - recording.host_s[0]) * 1e9).astype(np.int64)
    sequence = _sequence(recording)
    yield Hello(
        source=name,
        host_ns=int(host_ns[0]),
        rate_hz=recording.rate_hz,
        sampling_mode="recording",
        gyro_lsb_per_dps=recording.lsb_per_dps,
    )
    for k in range(n):
        yield RawSample(
            int(sequence[k]) % SEQUENCE_WRAP,
            int(device_us[k]) % TIME_WRAP_US,
            int(host_ns[k]),
            tuple(recording.gyro[order[k]].tolist()),
            None if recording.accel is None else tuple(recording.accel[order[k]].tolist()),
        )


def _sequence(recording: Recording) -> NDArray[np.int64]:
    """Number the samples as a device does: where time runs ahead of the rate, samples are missing."""
    steps = np.maximum(1, np.round(np.diff(recording.device_s) * recording.rate_hz))
    return np.concatenate(([0], np.cumsum(steps))).astype(np.int64)


def _from_ndjson(records: list[Hello | Sample | Epoch], cut: str | None) -> Iterator[Event]:
    """Our own output as events; numbers and times are unwrapped already, epochs begin where it says."""
    if cut is not None:
        yield Trouble("cut_recording", cut, records[0].host_ns, fatal=False)
    hello = None
    for record in records:
        match record:
            case Hello():
                hello = record
                yield record
            case Epoch(reason=reason) if reason != "gap":  # a gap is found anew, by the limit of now
                yield Break(record.reason, record.host_ns)
            case Sample():
                assert hello is not None  # read_ndjson refuses samples before it
                yield to_counts(record, hello)
