"""A recording as a source: as fast as it can, or at its own pace; in its order, or shuffled."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fltea.continuity import SEQUENCE_WRAP, TIME_WRAP_US
from fltea.errors import UsageError
from fltea.model import Event, Hello, LinkStats, RawSample, Sample
from fltea.sources.pacing import sleep_until
from fltea.sources.recording import Recording, read_csv, read_ndjson, read_npz


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
        self._realtime = realtime
        self._closed = False
        printable = str(path).encode(errors="replace").decode()  # a name may hold bytes that are no text
        name = f"replay:{printable}" + ("" if shuffle is None else f" (shuffled, seed {shuffle})")
        suffix = path.suffix.lower()
        if suffix in (".ndjson", ".jsonl"):
            self._events = _from_ndjson(read_ndjson(path))
            if shuffle is not None:
                raise UsageError(f"{path}: --shuffle works on .npz and CSV recordings.")
        elif suffix == ".npz":
            self._events = _from_recording(name, read_npz(path), shuffle)
        elif suffix in (".csv", ".txt"):
            self._events = _from_recording(name, read_csv(path, columns, units or "dps", rate_hz), shuffle)
        else:
            raise UsageError(f"{path}: the kind is not known by its ending; .npz, .csv or .ndjson is needed.")
        if suffix not in (".csv", ".txt") and (columns or units or rate_hz):
            raise UsageError(
                f"{path}: --columns, --units and --rate are for CSV files; this one names its own."
            )
        samples = sum(isinstance(e, RawSample) for e in self._events)
        if samples <= startup:
            raise UsageError(
                f"{path}: {samples} rows, but the start-up window alone takes {startup} and estimates begin "
                "after it. Record for longer, or shorten the window: --startup N."
            )

    def events(self) -> Iterator[Event]:
        """Yield the recording's events."""
        begin_ns = time.monotonic_ns() - (self._events[0].host_ns if self._events else 0)
        for event in self._events:
            if self._realtime:
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


def _from_recording(name: str, recording: Recording, shuffle: int | None) -> list[Hello | RawSample]:
    n = len(recording.gyro)
    order = np.arange(n) if shuffle is None else np.random.default_rng(shuffle).permutation(n)
    device_us = np.round((recording.device_s - recording.device_s[0]) * 1e6).astype(np.int64)
    host_ns = device_us * 1000
    if recording.host_s is not None:
        host_ns = np.round((recording.host_s - recording.host_s[0]) * 1e9).astype(np.int64)
    gyro = recording.gyro[order].tolist()
    accel = None if recording.accel is None else recording.accel[order].tolist()
    events: list[Hello | RawSample] = [
        Hello(
            source=name,
            host_ns=int(host_ns[0]),
            rate_hz=recording.rate_hz,
            sampling_mode="recording",
            gyro_lsb_per_dps=recording.lsb_per_dps,
        )
    ]
    sequence = _sequence(recording)
    for k in range(n):
        events.append(
            RawSample(
                int(sequence[k]) % SEQUENCE_WRAP,
                int(device_us[k]) % TIME_WRAP_US,
                int(host_ns[k]),
                tuple(gyro[k]),
                None if accel is None else tuple(accel[k]),
            )
        )
    return events


def _sequence(recording: Recording) -> NDArray[np.int64]:
    """Number the samples as a device does: where time runs ahead of the rate, samples are missing."""
    steps = np.maximum(1, np.round(np.diff(recording.device_s) * recording.rate_hz))
    return np.concatenate(([0], np.cumsum(steps))).astype(np.int64)


def _from_ndjson(records: list[Hello | Sample]) -> list[Hello | RawSample]:
    """Sample records hold deg/s already; HELLO's scale is kept for the resolution it tells."""
    events: list[Hello | RawSample] = []
    lsb: float | None = None
    for item in records:
        if isinstance(item, Hello):
            lsb = item.gyro_lsb_per_dps
            events.append(item)
            continue
        events.append(
            RawSample(
                item.seq % SEQUENCE_WRAP,
                item.device_us % TIME_WRAP_US,
                item.host_ns,
                # counts are whole numbers: rounding undoes the division by lsb exactly
                tuple(round(g * lsb) if lsb else g for g in item.gyro_dps),
                flags=item.flags,
            )
        )
    return events
