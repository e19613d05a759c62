"""Summarises a recording: the device, the duration, and what is missing."""

from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from fltea.recording.bag_files import bags_in
from fltea.recording.kind import is_one_file
from fltea.recording.reading import Answer
from fltea.records.events import Trouble
from fltea.records.records import Hello
from fltea.records.stats import LinkStats
from fltea.records.visible import visible
from fltea.settings.duration import Duration
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits
from fltea.sources.replay import ReplaySource, mcap_sessions, open_mcap
from fltea.stream.decode import Decoded, Decoder

if TYPE_CHECKING:
    from fltea.sources.mcap import McapRecording


OF_A_FILE = "recording"
"""Sampling mode in the summary of another program's file, which describes no device."""


class Summary(msgspec.Struct, frozen=True, tag_field="class", tag="recording"):
    """The summary of one recording.

    `whole`: all files were finished properly and were read completely.
    `breaks`: gaps that the recorder itself caused.
    `unrecorded_items`, `unrecorded_bytes`: items and bytes that the recorder counted in these gaps.
    `damaged_bytes`: unreadable bytes in the files.
    `missing`: text that says which files before the first one are missing.
    `being_written`: whether a program is still writing the recording.
    `epochs`: number of epochs (stretches of samples without a restart) by the reason for their beginning.
    `samples`, `lost`, `gaps`, `duplicates`, `before_hello`, `rate_differs`: the counts of these names in the
    `stats` record.
    `steps`, `motions`: number of bias steps and of motions in the records; None if there are no such records.
    `resets`: number of times that the device booted again after its first boot.
    `rate_hz`, `clock_ppm`: sampling rate [Hz] and clock deviation [ppm] in the longest epoch.
    `notes`: texts of the `error` records that reading caused.
    `unread`: why files were not, or not completely, read.
    `about`: further description in the file.
    `reading`: the answers (units, columns, rate) by which another program's file was read.
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
    samples: int
    lost: int
    gaps: int
    duplicates: int
    before_hello: int
    rate_differs: int
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
    name = str(paths[0])
    files = list(paths)
    source: McapRecording | ReplaySource
    mcap: McapRecording | None = None
    device = session = None
    if len(paths) == 1 and is_one_file(paths[0]):
        source = ReplaySource(paths[0], how=how, limits=limits)
    else:
        source = mcap = open_mcap(paths, name, limits)()
        files = [part.path for part in source.parts]
        if len(files) > 1:
            from fltea.sources.mcap import name_of

            name = str(name_of(files[0]))
        device, session = source.parts[0].info.device, source.parts[0].info.session
    decoder = Decoder(lambda: source.unix_offset_ns, max_gap)
    hello, boots, first_ns, last_ns = None, set(), None, 0
    epochs: Counter[str] = Counter()
    longest: tuple[int, float | None, float | None] = (0, None, None)
    of_epoch = 0
    notes: list[str] = []
    cut, has_clock = False, False
    for event in source.events():
        if isinstance(event, Trouble) and mcap is None:
            notes.append(event.message)
            cut = cut or event.kind in ("cut_recording", "recording_gap")
        if isinstance(event, Hello):
            unix_ns = event.host_ns + source.unix_offset_ns
            hello = msgspec.structs.replace(event, host_ns=unix_ns, device=device)
            boots.add((event.boot_id, event.device_id))
        for found in decoder.feed(event):
            if not isinstance(found, Decoded):
                continue
            if found.new_epoch is not None:
                epochs[found.new_epoch] += 1
                of_epoch = 0
            of_epoch += len(found.block)
            # If the file holds no arrival times, the device's times are used as arrival times.
            has_clock = has_clock or bool((found.raw.host_ns != found.block.device_us * 1000).any())
            if of_epoch >= longest[0]:
                longest = of_epoch, decoder.native.rate_hz, decoder.native.clock_ppm
            first_ns = int(found.block.host_ns[0]) if first_ns is None else first_ns
            last_ns = int(found.block.host_ns[-1])
    count, unread = decoder.counts, mcap.unread if mcap else []
    return Summary(
        name=name,
        device=device,
        session=session,
        hello=hello,
        files=len(files),
        size_bytes=sum(map(_size_bytes, files)),
        whole=not (mcap and (mcap.torn or mcap.open or mcap.missing_before)) and not (cut or unread),
        breaks=mcap.breaks if mcap else 0,
        start_unix_ns=first_ns if source.unix_offset_ns else None,
        duration_s=0.0 if first_ns is None else (last_ns - first_ns) * 1e-9,
        samples=count.delivered,
        lost=count.lost,
        gaps=count.gaps,
        duplicates=count.duplicates,
        before_hello=count.before_hello,
        rate_differs=count.rate_differs,
        resets=max(0, len(boots) - 1),
        epochs=dict(epochs),
        rate_hz=longest[1],
        clock_ppm=longest[2] if has_clock else None,
        link=source.link_stats(),
        steps=source.changes.steps,
        motions=source.changes.motions,
        notes=notes,
        unread=unread,
        about=source.about if isinstance(source, ReplaySource) else "",
        reading=list(source.reading) if isinstance(source, ReplaySource) else [],
        unrecorded_items=mcap.unrecorded_items if mcap else 0,
        unrecorded_bytes=mcap.unrecorded_bytes if mcap else 0,
        damaged_bytes=mcap.damaged_bytes if mcap else 0,
        missing=mcap.missing_before if mcap else "",
        being_written=bool(mcap and mcap.open),
    )


def _size_bytes(path: Path) -> int:
    files = path.iterdir() if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files)


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
    early = "" if is_foreign else f", {s.before_hello} before a HELLO"
    if s.rate_differs:
        early += f", {s.rate_differs} whose times contradict the rate of HELLO"
    lines.append(("samples", f"{s.samples}, {s.lost} lost in {s.gaps} gaps{early}"))
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
        remedy = "" if s.about or _is_foreign(s) else " (fltea recover)"  # applies to fltea's files only
        faults.append(f"not finished: killed, cut or damaged{remedy}")
    return ", ".join(faults) or "whole"


def _missed(s: Summary) -> str:
    """Return a text that says what is missing in the recording, as far as the loss was counted."""
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
