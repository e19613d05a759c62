"""The commands `fltea record`, `info`, `export` and `recover`."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from fltea.cli.output import end_with, escaped, print_lines, say
from fltea.cli.setting_flags import LIMITS, RECORDING, takes_settings
from fltea.records.errors import FlteaError, Incomplete, UsageError
from fltea.settings.config import load_config
from fltea.settings.duration import MOST_S
from fltea.settings.extras import load

Recordings = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE|DIR…",
        help="Files of a recording, a folder, the name of a session (without _000.mcap), or ROS bags.",
        show_default=False,
    ),
]


@takes_settings(["record.rotate_mb", "record.rotate_s", "link.baud", *RECORDING])
def record(
    settings: dict[str, Any],
    folder: Annotated[str, typer.Argument(metavar="DIR", help="Folder for the files.")] = "recordings",
    source: Annotated[
        str | None,
        typer.Option("--source", "-s", metavar="URL", help="As for `fltea run`; default: the Arduino Due."),
    ] = None,
    for_: Annotated[
        float | None, typer.Option("--for", metavar="SECONDS", help="Stop after this time.")
    ] = None,
    raw: Annotated[
        bool,
        typer.Option("--raw", help="Only the bytes from the wire, without decoded samples: half the size."),
    ] = False,
) -> None:
    """Record a device in MCAP files, raw bytes and samples, without estimating anything.

    Ctrl-C ends it. `fltea run -s replay:DIR` estimates later; `fltea run --record DIR` does both at once.

    For example:

        fltea record --for 3600

        fltea record -s serial:/dev/ttyACM0 night --rotate-s 600
    """
    if for_ is not None and not 0 < for_ < MOST_S:
        raise UsageError(f"--for takes a positive number of seconds, up to {MOST_S:g}.")
    channels = () if raw else ("hello", "gap", "sample", "error")
    config = load_config(
        None, {"source": source, "record.folder": folder, "record.channels": list(channels)} | settings
    )
    run = load("fltea.archive.record", "mcap", "record", "MCAP files need")
    say(run.record(config, for_))


@takes_settings(["link.max_gap", *RECORDING], only=LIMITS)
def info(
    paths: Recordings,
    settings: dict[str, Any],
    json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object per recording, each on a line.")
    ] = False,
) -> None:
    """Show what recordings hold: device, settings, duration, samples, gaps, resets and rate.

    Everything is counted again from the raw bytes, which takes some minutes for a day at 100 Hz.

    For example:

        fltea info recordings

        fltea info rest.csv --units dps

        fltea info --json recordings/due_20270801T120000Z_1f0c2b3a
    """
    from fltea.archive.info import as_json, as_text, sessions, summarise

    config = load_config(None, settings)
    failures: list[FlteaError] = []
    for number, files in enumerate(sessions(paths)):
        try:
            summary = summarise(files, config.link.max_gap, config.replay.limits, config.replay.how)
        except FlteaError as error:
            failures.append(error)
            continue
        if json:
            print(escaped(as_json(summary).decode()))
        else:
            print_lines(("\n" if number else "") + as_text(summary))
        if summary.unread:
            failures.append(Incomplete(summary.unread))
    end_with(failures)


@takes_settings(["link.max_gap", *RECORDING], only=LIMITS)
def export(
    paths: Recordings,
    settings: dict[str, Any],
    to: Annotated[Path, typer.Option("--to", metavar="OUT.csv|OUT.npz", help="File to write.")],
    what: Annotated[
        Literal["samples", "corrected", "estimates", "device_estimates", "fits", "steps", "motions"],
        typer.Option(
            help="`samples`; `corrected`: rates minus their biases, with σ; `estimates` as published; "
            "`device_estimates`: those of the device; `fits`: the maximum-likelihood fits; `steps` of the "
            "bias; `motions` of the sensor."
        ),
    ] = "samples",
    force: Annotated[bool, typer.Option("--force", help="Replace OUT if it exists.")] = False,
) -> None:
    """Write one recording as a table, with the units in the headers.

    `fltea run -s replay:OUT.npz` gives the same estimates as the recording. A CSV file holds no scale and no
    epochs, so it gives the same estimates only for a recording without gaps, with `--rate`.

    For example:

        fltea export recordings/due_20270801T120000Z_1f0c2b3a --to rest.npz

        fltea export night --to night.csv --what estimates

        fltea export drive.csv --units deg/s --to rates.csv --what corrected
    """
    from fltea.archive.export import export as write_export

    config = load_config(None, settings)
    limits, how = config.replay.limits, config.replay.how
    written = write_export(paths, to, what, config.link.max_gap, force=force, limits=limits, how=how)
    say(f"{to}: {written.rows} {what.replace('corrected', 'corrected rates')}")
    if written.unread:
        raise Incomplete(written.unread)


@takes_settings([], only=LIMITS)
def recover(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="FILE…", help="MCAP files, or folders of them.", show_default=False),
    ],
    settings: dict[str, Any],
    in_place: Annotated[
        bool,
        typer.Option("--in-place", help="Replace the file, instead of writing NAME.recovered.mcap."),
    ] = False,
) -> None:
    """Repair MCAP files that a killed program or a full disk cut off: add summary and indexes.

    fltea itself reads such files without repair; other programs need the summary and indexes.

    For example:

        fltea recover recordings
    """
    recovery = load("fltea.recording.recovery", "mcap", "record", "MCAP files need")
    limits = load_config(None, settings).replay.limits
    failures = []
    for path in paths:
        files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        if not files:
            raise UsageError(f"{path}: no .mcap file in this folder.")
        for file in files:
            try:
                found = recovery.recover(file, in_place=in_place, limits=limits)
            except FlteaError as error:  # go on: the files after this one can still be repaired
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
    end_with(failures)
