"""The commands `fltea record`, `info`, `export` and `recover`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from fltea.cli import how
from fltea.cli.output import print_lines, say
from fltea.records.errors import FlteaError, UsageError
from fltea.settings.config import LinkConfig
from fltea.settings.duration import Duration
from fltea.settings.extras import load
from fltea.settings.how import How
from fltea.wire import layout as wire

if TYPE_CHECKING:
    from fltea.settings.limits import Limits

MAX_GAP = str(LinkConfig().max_gap)

Recordings = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE|DIR…",
        help="Files of a recording, a folder, the name of a session (without _000.mcap), or ROS bags.",
        show_default=False,
    ),
]

ReplaySettings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="A limit on memory: replay.max_chunk_mb (of MCAP) or replay.max_mb (of other files).",
    ),
]


MaxGap = Annotated[
    str,
    typer.Option(metavar="N|TIME", help="Longest gap within an epoch, in samples or as a time such as 1s."),
]


def _max_gap(text: str) -> Duration:
    from fltea.settings.config import load_config, of_flags

    return load_config(None, of_flags({"link.max_gap": text})).link.max_gap


def _limits(texts: list[str] | None) -> "Limits":
    from fltea.settings.config import load_config, parse_setting

    settings = dict(parse_setting(text) for text in texts or ())
    for path in settings:
        if path not in ("replay.max_chunk_mb", "replay.max_mb"):
            raise UsageError(f"--set {path}: here it takes replay.max_chunk_mb and replay.max_mb only.")
    return load_config(None, settings).replay.limits


def record(
    folder: Annotated[str, typer.Argument(metavar="DIR", help="Where the files go.")] = "recordings",
    source: Annotated[
        str | None,
        typer.Option("--source", "-s", metavar="URL", help="As of `fltea run`; default: the Arduino Due."),
    ] = None,
    rotate_mb: Annotated[
        float | None, typer.Option(metavar="MB", help="A new file beyond this size (default 256).")
    ] = None,
    rotate_s: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="A new file beyond this age (default 3600).")
    ] = None,
    for_: Annotated[
        float | None, typer.Option("--for", metavar="SECONDS", help="Stop after this time.")
    ] = None,
    raw: Annotated[
        bool, typer.Option("--raw", help="The bytes from the wire only, no decoded samples: half the size.")
    ] = False,
    baud: Annotated[int | None, typer.Option(help=f"Serial speed (default {wire.BAUD}).")] = None,
) -> None:
    """Record a device without estimating anything: raw bytes and samples, in MCAP files.

    Ctrl-C ends it. `fltea run -s replay:DIR` estimates later; `fltea run --record DIR` does both at once.

    For example:

        fltea record --for 3600

        fltea record -s serial:/dev/ttyACM0 night --rotate-s 600
    """
    from fltea.settings.config import load_config

    if for_ is not None and not for_ > 0:
        raise UsageError("--for takes a positive number of seconds.")
    channels = () if raw else ("hello", "gap", "sample", "error")
    flags = {
        "source": source,
        "record.folder": folder,
        "record.rotate_mb": rotate_mb,
        "record.rotate_s": rotate_s,
        "record.channels": list(channels),
        "link.baud": baud,
    }
    config = load_config(None, {path: value for path, value in flags.items() if value is not None})
    run = load("fltea.archive.record", "mcap", "record", "MCAP files need")
    say(run.record(config, for_))


def info(
    paths: Recordings,
    json: Annotated[
        bool, typer.Option("--json", help="One JSON object a recording, each on a line.")
    ] = False,
    max_gap: MaxGap = MAX_GAP,
    topic: how.Topic = None,
    set_: ReplaySettings = None,
) -> None:
    """Sum recordings up: device, settings, duration, samples, gaps, resets, rate, and what is missing.

    Everything is counted again from the raw bytes, which takes some minutes for a day at 100 Hz.

    For example:

        fltea info recordings

        fltea info --json recordings/due_20270801T120000Z_1f0c2b3a
    """
    import msgspec

    from fltea.archive.info import as_text, sessions, summarise

    limits = _limits(set_)
    for number, files in enumerate(sessions(paths)):
        summary = summarise(files, _max_gap(max_gap), limits, How(topic=topic))
        if json:
            print(msgspec.json.encode(summary).decode())
        else:
            print_lines(("\n" if number else "") + as_text(summary))


def export(
    paths: Recordings,
    to: Annotated[Path, typer.Option("--to", metavar="OUT.csv|OUT.npz", help="What to write.")],
    what: Annotated[
        Literal["samples", "estimates", "device_estimates", "fits"],
        typer.Option(
            help="`samples`, decoded again; `estimates` as they were published; `device_estimates`: those "
            "that the device made beside the host's; `fits` of the maximum-likelihood fit."
        ),
    ] = "samples",
    max_gap: MaxGap = MAX_GAP,
    force: Annotated[bool, typer.Option("--force", help="Replace OUT if it exists already.")] = False,
    topic: how.Topic = None,
    set_: ReplaySettings = None,
) -> None:
    """Write one recording as a table, with the units in the headers.

    `fltea run -s replay:OUT.npz` gives the same estimates as the recording; a CSV file has no scale and no
    epochs, so it does so only for a recording without gaps, with `--rate`.

    For example:

        fltea export recordings/due_20270801T120000Z_1f0c2b3a --to rest.npz

        fltea export night --to night.csv --what estimates
    """
    from fltea.archive.export import export as write_export

    chosen = How(topic=topic)
    rows = write_export(paths, to, what, _max_gap(max_gap), force=force, limits=_limits(set_), how=chosen)
    say(f"{to}: {rows} {what}")


def recover(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="FILE…", help="MCAP files, or folders of them.", show_default=False),
    ],
    in_place: Annotated[
        bool,
        typer.Option("--in-place", help="Replace the file; else NAME.recovered.mcap is written beside it."),
    ] = False,
    set_: ReplaySettings = None,
) -> None:
    """Make whole files of those that a killed program or a full disk left: with summary and indexes.

    fltea itself reads such files as they are; other programs want them whole.

    For example:

        fltea recover recordings
    """
    recovery = load("fltea.recording.recovery", "mcap", "record", "MCAP files need")
    limits = _limits(set_)
    failures = []
    for path in paths:
        files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        if not files:
            raise UsageError(f"{path}: no .mcap file in this folder.")
        for file in files:
            try:
                found = recovery.recover(file, in_place=in_place, limits=limits)
            except FlteaError as error:  # the others can still be saved
                failures.append(error)
                continue
            if found.out is None:
                print_lines(f"{file}: is whole")
                continue
            damaged = f", {found.damaged_chunks} chunks were damaged" if found.damaged_chunks else ""
            print_lines(
                f"{found.out}: {found.messages} messages over {found.seconds:.1f} s saved; "
                f"{found.lost_bytes} bytes at the end could not be read{damaged}"
            )
    for failure in failures[1:]:
        say(f"fltea: error: {failure}")
    if failures:
        raise failures[0]
