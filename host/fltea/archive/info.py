"""Summarises a recording: the device, the duration, and what is missing."""

from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from fltea.recording.bag_files import bags_in
from fltea.recording.kind import is_one_file
from fltea.recording.reading import Answer
from fltea.records.events import Event, Trouble
from fltea.records.records import Hello
from fltea.records.stats import LinkStats, SampleStats
from fltea.records.visible import visible
from fltea.settings.duration import Duration
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits
from fltea.sources.replay import ReplaySource, mcap_sessions, open_mcap
from fltea.stream.decode import Decoded, Decoder

if TYPE_CHECKING:
    from fltea.sources.mcap import McapRecording


OF_SAMPLES = {"delivered": "samples"}
"""Names of counts of samples in the summary as JSON, if they have another name in the `stats` record."""

OF_A_FILE = "recording"
"""What the summary gives as the sampling mode of a file that another program wrote."""


# Why more than 12 attributes: each is one fact that `fltea info --json` prints.
class Summary(msgspec.Struct, frozen=True, tag_field="class", tag="recording"):
    """The summary of one recording.

    `whole`: all files were finished properly and were read completely. `breaks`: number of gaps that the
    recorder itself caused. `unrecorded_items`, `unrecorded_bytes`: items and bytes that were not recorded
    in these gaps. `damaged_bytes`: unreadable bytes in the files. `missing`: text that says which files
    before the first one are missing. `being_written`: whether a program is still writing the recording.
    `epochs`: number of epochs, by the reason for their beginning.
    `counts`: the counts of samples in the `stats` record; `fltea info --json` prints each as a field of its
    own, `delivered` as `samples`. `steps`, `motions`: number of bias steps and of motions in the records;
    None if there are no such records. `resets`: number of times that the device booted again after its first
    boot. `rate_hz`, `clock_ppm`: sampling rate [Hz] and clock deviation [ppm] in the longest epoch. `notes`:
    texts of the `error` records that reading caused. `unread`: why files were not, or not completely, read.
    `about`: further description that the file contains. `reading`: the answers (units, columns, rate) by
    which another program's file was read.
    """

    name: str
    device: str | None
    session: str | None
    hello: Hello | None
    files: int
    size_bytes: int
    whole: bool
    breaks: int
    start_unix_ns: int | None
    duration_s: float
    counts: SampleStats
    resets: int
    epochs: dict[str, int]
    rate_hz: float | None
    clock_ppm: float | None
    link: LinkStats
    steps: int | None = None
    motions: int | None = None
    notes: list[str] = []
    unread: list[str] = []
    about: str = ""
    reading: list[Answer] = []
    unrecorded_items: int = 0
    unrecorded_bytes: int = 0
    damaged_bytes: int = 0
    missing: str = ""
    being_written: bool = False


def sessions(paths: Sequence[Path]) -> list[list[Path]]:
    """Return the recordings in these files and folders, each as a list of its files.

    Raises:
        UsageError: there is no recording.
    """
    paths = [path for one in paths for path in bags_in(one) or [one]]
    single = [[path] for path in paths if is_one_file(path)]
    others = [path for path in paths if not is_one_file(path)]
    return single + (mcap_sessions(others) if others else [])


def summarise(
    paths: Sequence[Path], max_gap: Duration, limits: Limits = DEFAULT_LIMITS, how: How = AS_IT_SAYS
) -> Summary:
    """Read a recording once, from its raw bytes, and summarise it.

    Raises:
        UsageError: the files cannot be read, are no recording, or need more memory than the limits allow.
    """
    source, mcap, files, name = _open(paths, limits, how)
    part = None if mcap is None else mcap.parts[0].info
    tally = _Tally(source, None if part is None else part.device, max_gap)
    for event in source.events():
        tally.take(event)
    first_ns, longest = tally.first_ns, tally.longest
    unread = mcap.unread if mcap else []
    # for files that fltea wrote, other fields of the summary (`breaks`, `damaged_bytes` …) state the faults
    troubles = tally.troubles if mcap is None else []
    cut = any(trouble.kind in ("cut_recording", "recording_gap") for trouble in troubles)
    return Summary(
        name=name,
        device=None if part is None else part.device,
        session=None if part is None else part.session,
        hello=tally.hello,
        files=len(files),
        size_bytes=sum(map(_size_bytes, files)),
        whole=not (mcap and (mcap.losses.torn or mcap.losses.open or mcap.missing_before))
        and not (cut or unread),
        breaks=mcap.losses.breaks if mcap else 0,
        start_unix_ns=first_ns if source.unix_offset_ns else None,
        duration_s=0.0 if first_ns is None else (tally.last_ns - first_ns) * 1e-9,
        counts=tally.decoder.counts,
        resets=max(0, len(tally.boots) - 1),
        epochs=dict(tally.epochs),
        rate_hz=longest.rate_hz,
        clock_ppm=longest.clock_ppm if tally.has_arrivals else None,
        link=source.link_stats(),
        steps=source.changes.steps,
        motions=source.changes.motions,
        notes=[trouble.message for trouble in troubles],
        unread=unread,
        about=source.about if isinstance(source, ReplaySource) else "",
        reading=list(source.reading) if isinstance(source, ReplaySource) else [],
        unrecorded_items=mcap.losses.unrecorded_items if mcap else 0,
        unrecorded_bytes=mcap.losses.unrecorded_bytes if mcap else 0,
        damaged_bytes=mcap.losses.damaged_bytes if mcap else 0,
        missing=mcap.missing_before if mcap else "",
        being_written=bool(mcap and mcap.losses.open),
    )


def _open(
    paths: Sequence[Path], limits: Limits, how: How
) -> "tuple[McapRecording | ReplaySource, McapRecording | None, list[Path], str]":
    """Open a recording.

    Return four things:
        the source that reads the recording
        the same source if fltea recorded it (as MCAP), otherwise None
        the recording's files
        the recording's name
    """
    if len(paths) == 1 and is_one_file(paths[0]):
        return ReplaySource(paths[0], how=how, limits=limits), None, list(paths), str(paths[0])
    mcap = open_mcap(paths, str(paths[0]), limits)()
    files = [part.path for part in mcap.parts]
    if len(files) == 1:
        return mcap, mcap, files, str(paths[0])
    from fltea.sources.mcap import name_of

    return mcap, mcap, files, str(name_of(files[0]))


class _Longest(NamedTuple):
    """The epoch with the most samples.

    The sampling rate [Hz] and the clock deviation [ppm] are the values at the end of this epoch.
    """

    samples: int = 0
    rate_hz: float | None = None
    clock_ppm: float | None = None


class _Tally:
    """Counts what the events of a recording report, such as samples, epochs and boots."""

    def __init__(self, source: "McapRecording | ReplaySource", device: str | None, max_gap: Duration) -> None:
        self._source, self._device = source, device
        self.decoder = Decoder(lambda: source.unix_offset_ns, max_gap)
        self.hello: Hello | None = None
        self.boots: set[tuple[int | None, str | None]] = set()
        self.epochs: Counter[str] = Counter()
        self.longest = _Longest()
        self.first_ns: int | None = None
        self.last_ns = 0
        self.has_arrivals = False
        """Whether the recording says when the host received samples; else `host_ns` is the device's time."""
        self.troubles: list[Trouble] = []
        self._of_epoch = 0

    def take(self, event: Event) -> None:
        """Count an event."""
        if isinstance(event, Trouble):
            self.troubles.append(event)
        if isinstance(event, Hello):
            unix_ns = event.host_ns + self._source.unix_offset_ns
            self.hello = msgspec.structs.replace(event, host_ns=unix_ns, device=self._device)
            self.boots.add((event.boot_id, event.device_id))
        for found in self.decoder.feed(event):
            if isinstance(found, Decoded):
                self._count(found)

    def _count(self, found: Decoded) -> None:
        if found.new_epoch is not None:
            self.epochs[found.new_epoch] += 1
            self._of_epoch = 0
        block, native = found.block, self.decoder.native
        self._of_epoch += len(block)
        self.has_arrivals = self.has_arrivals or bool((found.raw.host_ns != block.device_us * 1000).any())
        if self._of_epoch >= self.longest.samples:
            self.longest = _Longest(self._of_epoch, native.rate_hz, native.clock_ppm)
        if self.first_ns is None:
            self.first_ns = int(block.host_ns[0])
        self.last_ns = int(block.host_ns[-1])


def _size_bytes(path: Path) -> int:
    files = path.iterdir() if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files)


def as_json(s: Summary) -> bytes:
    """Return the summary as a JSON object, in which each count of samples is a field of its own."""
    fields: dict[str, Any] = {}
    for name, value in msgspec.to_builtins(s).items():
        fields |= {OF_SAMPLES.get(k, k): n for k, n in value.items()} if name == "counts" else {name: value}
    return msgspec.json.encode(fields)


def as_text(s: Summary) -> str:
    """Return the summary as text, with one line for each fact."""
    lines: list[tuple[str, Any]] = [("recording", s.name)]
    if s.session is not None:
        lines.append(("device", f"{s.device}, session {s.session}"))
    is_foreign = _is_foreign(s)
    if s.hello is not None and not is_foreign:
        lines += _hello_lines(s.hello)
    if s.about:
        lines.append(("about", s.about))
    lines += [(one.question, one) for one in s.reading]
    lines.append(("files", f"{s.files}, {_size(s.size_bytes)}, {_state(s)}"))
    if s.start_unix_ns is not None:
        start = datetime.fromtimestamp(s.start_unix_ns * 1e-9, UTC)
        lines.append(("start", f"{start:%Y-%m-%d %H:%M:%S} UTC"))
    lines.append(("duration", _duration(s.duration_s)))
    counts = s.counts
    early = "" if is_foreign else f", {counts.before_hello} before a HELLO"
    if counts.rate_differs:
        early += f", {counts.rate_differs} whose times contradict the rate of HELLO"
    lines.append(("samples", f"{counts.delivered}, {counts.lost} lost in {counts.gaps} gaps{early}"))
    reasons = ", ".join(f"{count} x {reason}" for reason, count in s.epochs.items()) or "none"
    if not is_foreign or reasons != "1 x start":
        lines.append(("epochs", reasons))
    if s.steps is not None and s.motions is not None:
        lines.append(("bias", f"{s.steps} steps; the sensor moved {s.motions} times"))
    if not is_foreign:
        lines.append(("resets", f"{s.resets} of the device, {s.link.reconnects} times reconnected"))
        lines.append(("breaks", f"{s.breaks} in the recording itself{_missed(s)}"))
    if s.link.frames:
        bad = ", ".join(f"{count} {reason}" for reason, count in s.link.bad_frames.items()) or "no bad one"
        lines.append(("frames", f"{s.link.frames}, {bad}; {s.link.bytes / 1e6:.1f} MB from the wire"))
    if s.rate_hz is not None:
        ppm = "" if s.clock_ppm is None else f", device clock {s.clock_ppm:+.1f} ppm against the host's"
        lines.append(("rate", f"{s.rate_hz:.4f} Hz{ppm}"))
    lines += [("note", note) for note in s.notes]
    lines += [("not read", why) for why in s.unread]
    return "\n".join(f"{name:<13} {visible(str(text))}" for name, text in lines)


def _is_foreign(s: Summary) -> bool:
    """Return whether another program wrote the recording."""
    return s.hello is not None and s.hello.sampling_mode == OF_A_FILE


def _state(s: Summary) -> str:
    """Return the state of the files, in words."""
    faults = ["not all could be read"] if s.unread else []
    faults += [s.missing] if s.missing else []
    if s.being_written:
        faults.append("still being written")
    if not faults and not s.whole:
        # other recordings have no index that `fltea recover` could write again
        remedy = "" if s.session is None else " (fltea recover)"
        faults.append(f"not finished: killed, cut or damaged{remedy}")
    return ", ".join(faults) or "whole"


def _missed(s: Summary) -> str:
    """Return a text: how many items (raw reads, records …) are missing, and how many bytes are unreadable.

    The text is empty if nothing is missing or unreadable.
    """
    found = ""
    if s.unrecorded_items:
        found += f"; {s.unrecorded_items} items with {s.unrecorded_bytes} bytes of the wire were not recorded"
    if s.damaged_bytes:
        found += f"; {s.damaged_bytes} bytes of the files cannot be read"
    return found


def _hello_lines(h: Hello) -> list[tuple[str, str]]:
    lines = []
    if h.device_id is not None:
        lines.append(("firmware", f"{h.firmware_version or 'not known'}, device id {h.device_id}"))
    sensor = h.sensor or "not known"
    if h.gyro_range_dps:
        sensor += f", ±{h.gyro_range_dps:g} deg/s"
    if h.gyro_lsb_per_dps:
        sensor += f" ({h.gyro_lsb_per_dps:g} LSB per deg/s)"
    if h.gyro_dlpf_hz:
        sensor += f", low-pass {h.gyro_dlpf_hz:g} Hz"
    return [
        *lines,
        ("sensor", sensor),
        ("settings", f"{h.rate_hz:g} Hz nominal, sampled by {h.sampling_mode}"),
    ]


def _size(size_bytes: int) -> str:
    return f"{size_bytes / 1e6:.1f} MB" if size_bytes >= 1e5 else f"{size_bytes / 1e3:.1f} kB"


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min {rest:02d} s"
