"""The command `fltea identify`: it makes requests from flags, and prints the results."""

import io
import json as json_module
import re
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fltea.cli import exports, many
from fltea.cli.output import AsJson, end_with, escaped, print_result, progress_bar, say
from fltea.cli.setting_flags import FILTERS, RECORDING, ConfigFile, takes_settings
from fltea.identification.dask_address import check_address, trust_warning
from fltea.recording.formats import ENDINGS
from fltea.records.errors import FlteaError, Incomplete, UsageError
from fltea.records.whole_file import prepare_folder
from fltea.settings.extras import load

if TYPE_CHECKING:
    from fltea.identification.axis_report import FileReport
    from fltea.identification.workers import Workers


@takes_settings(["channels", *FILTERS, *RECORDING], of_both=True)
def identify(
    settings: dict[str, Any],
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE…",
            help=f"Recordings: {ENDINGS}, a folder, or the name of a session. With --out also URLs and "
            "patterns: 's3://lab/**/*.mcap'.",
            show_default=False,
        ),
    ],
    as_json: AsJson = False,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Write report.html with all figures, and the figures as SVG, to this folder."
        ),
    ] = None,
    config: ConfigFile = None,
    details: Annotated[bool, typer.Option("--details", help="Show all figures in a table.")] = False,
    forecast: Annotated[
        bool,
        typer.Option(
            "--forecast",
            help="Forecast the heading error over time from the first half, and check it on the second half.",
        ),
    ] = False,
    rest_for: Annotated[
        str | None,
        typer.Option(
            metavar="DEG@S",
            help="How long to rest so that the heading is good to ± DEG (95 %) after S seconds, such as "
            "0.5@60. Includes --forecast.",
        ),
    ] = None,
    drive_for: Annotated[
        str | None,
        typer.Option(
            metavar="DEG@S",
            help="For how many seconds the heading is good to ± DEG (95 %) after a rest of S seconds, such "
            "as 1@30: the inverse of --rest-for. Includes --forecast.",
        ),
    ] = None,
    sheet: Annotated[
        str | None,
        typer.Option(
            metavar="PART|DENSITY",
            help="Compare the noise with the data sheet of this part, such as MPU-9250, or with a rate noise "
            "density in dps/√Hz, such as 0.007.",
        ),
    ] = None,
    shuffles: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=0,
            help="With --json, --details or --report: number of shuffled copies on which FLTEA is run, to "
            "show what it gives for white noise of the same power; 0: none, and faster.",
        ),
    ] = 200,
    notch: Annotated[
        list[str] | None,
        typer.Option(
            metavar="HZ±HZ|LO-HI",
            help="Leave out a band of frequencies, such as 31.4±0.5 or 30.9-31.9; repeatable.",
        ),
    ] = None,
    from_hz: Annotated[
        float, typer.Option("--from-hz", metavar="HZ", help="Leave out all lower frequencies, such as drift.")
    ] = 0.0,
    export_model: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write the noise model of one recording, for `fltea simulate --model`."
        ),
    ] = None,
    imu_yaml: Annotated[
        Path | None,
        typer.Option(
            "--imu-yaml",
            metavar="FILE",
            help="Write imu.yaml for Kalibr, of both sensors unless --channels names axes.",
        ),
    ] = None,
    inflate: Annotated[
        str | None,
        typer.Option(
            metavar="X|X,Y|auto",
            help="--imu-yaml and --for: multiply noise densities by X, and random walks by Y (else X). 5 to "
            "20 is common, for errors that only motion shows. auto: compute the factors of each axis such "
            "that the forecast of the recording's first half holds in the second; includes --forecast.",
        ),
    ] = None,
    for_program: Annotated[
        str | None,
        typer.Option(
            "--for",
            metavar="NAME[@S]",
            help="Print only the noise settings of a program, in its own names and units: "
            "kalibr, openvins, vins-fusion, okvis2, kf-gins, gtsam, robot_localization, px4, ardupilot, "
            "matlab-imusensor or gnss-ins-sim. Noise that its settings cannot express is bounded for a "
            "heading of S seconds (60).",
        ),
    ] = None,
    gauss_markov: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write the noise parameters of a navigation filter as JSON: σ, τ, N, K, Q and drift, and "
            "`filter`, the matrices of a plain Kalman filter.",
        ),
    ] = None,
    allan_csv: Annotated[
        Path | None,
        typer.Option(
            "--allan-csv",
            metavar="FILE",
            help="Write the Allan deviations with their 95 % intervals, and those of the model, as CSV.",
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", metavar="N", min=1, help="Number of processes; default: all cores."),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Use an existing Dask cluster instead: tcp://HOST:8786 or tls://HOST:8786.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="NAME.parquet",
            help="For many files: write one row per axis to this table, and skip files that are in it "
            "(host/docs/guide/cluster.md).",
        ),
    ] = None,
) -> None:
    """Identify the noise of recordings of a sensor at rest: a verdict for each axis.

    The verdict names the components of the noise, with intervals, says whether the noise has a fractional
    order, and warns of what in the data can mislead. host/docs/guide/verdict.md explains every figure,
    host/docs/guide/bias_and_heading.md the forecast.

    For example:

        fltea identify rest.npz

        fltea identify recordings --report report --notch 31.4±0.5

        fltea identify *.npz --json --jobs 4 > verdicts.json

        fltea identify 's3://lab/2026-11/**/*.mcap' --dask tls://10.0.0.5:8786 --out verdicts.parquet
    """
    one_by_one = {
        "--json": as_json,
        "--report": report,
        "--export-model": export_model,
        "--imu-yaml": imu_yaml,
        "--gauss-markov": gauss_markov,
        "--allan-csv": allan_csv,
        "--sheet": sheet,
        "--for": for_program,
        "--drive-for": drive_for,
    }
    many.check(files, out, [name for name, value in one_by_one.items() if value])
    if dask is not None:
        if jobs is not None:
            raise UsageError("--jobs is for this machine, --dask for a cluster: give one of them.")
        check_address(dask)
    from fltea.identification import data_sheet, findings, run
    from fltea.identification import load as reading
    from fltea.identification.axis import IdentifyOptions
    from fltea.identification.forecast import asked_by
    from fltea.settings.config import load_configs

    part = None if sheet is None else data_sheet.sheet_name(sheet)
    ahead = asked_by(forecast, rest_for, drive_for)
    program = None if for_program is None else exports.parse_program(for_program)
    if program is not None and (as_json or details):
        raise UsageError("--for prints its lines and nothing else: leave --json and --details out.")
    configs = load_configs(config, settings)
    if len(configs) > 1:
        raise UsageError(
            f"{config}: has settings of several devices; give a file without [device] tables, or --set."
        )
    (chosen,) = configs
    try:
        options = IdentifyOptions(
            shuffles=shuffles, from_hz=from_hz, notch_hz=tuple(parse_notch(text) for text in notch or [])
        )
    except ValueError as error:
        raise UsageError(f"command line: {error}.") from error
    replay, wanted = chosen.replay, tuple(chosen.channels) if chosen.channels else None
    if out is not None:
        from fltea.cluster.whole import Ask

        ask = Ask(
            run.Settings(options, chosen.estimator, chosen.accel, live=chosen.live),
            wanted,
            replay.how,
            replay.limits,
        )
        many.identify_many(files, out, ask, lambda: _workers(jobs, dask))
        return
    inflation = exports.parse_inflation(inflate, imu_yaml or for_program)
    files_wanted = exports.Files(export_model, imu_yaml, gauss_markov, allan_csv, inflation)
    if report is not None:
        from fltea.identification import report as page

        prepare_folder("--report", report)
    found = reading.recordings([Path(file) for file in files])
    requests: list[reading.Request | reading.Unreadable] = [
        one
        if isinstance(one, reading.Unreadable)
        else reading.Request(
            one,
            wanted,
            replay.how,
            replay.limits,
            # imu.yaml and --for have entries for both sensors; else three more axes would double the time.
            accel=imu_yaml is not None or for_program is not None,
        )
        for one in found
    ]
    for_one = [*files_wanted.flags, *(["--for"] if program is not None else [])]
    if len(requests) > 1 and for_one:
        raise UsageError(f"for one recording alone, {len(requests)} were given: {', '.join(for_one)}.")
    by = run.Settings(
        options,
        chosen.estimator,
        chosen.accel,
        details=as_json or details or report is not None,  # a plain answer shows no details
        figures=report is not None,
        forecast=ahead or inflation == "auto",
        live=chosen.live,
    )
    reports = _run(requests, by, jobs, dask)
    if part is not None:
        for one in reports:
            one.compare_with(part)
    # Results are printed before files are written: an unwritable file must not lose minutes of computing.
    if program is not None:
        print_result(exports.lines_for(reports[0], *program, inflation))
    elif as_json:
        text = json_module.dumps(findings.document(reports), ensure_ascii=False, allow_nan=False)
        print_result(escaped(text) + "\n")
    else:
        _show(reports, details=details)
    if report is not None and (written := page.write(report, reports)):
        say(f"fltea: {written[0]}, and {len(written) - 1} figures")
    exports.write(reports[0], files_wanted)
    each = {"--sheet": sheet, "--forecast": forecast, "--rest-for": rest_for, "--drive-for": drive_for}
    _fail(reports, files_wanted.flags, [flag for flag, value in each.items() if value])


def parse_notch(text: str) -> tuple[float, float]:
    """Return the ends of a band such as `31.4±0.5`, `31.4+-0.5` or `30.9-31.9` [Hz].

    Raises:
        UsageError: the text is no band.
    """
    number = r"\s*(\d+\.?\d*|\.\d+)\s*"
    around = re.fullmatch(rf"{number}(?:±|\+-|\+/-){number}", text)
    between = re.fullmatch(rf"{number}(?:-|–|…|\.\.){number}", text)
    if around:
        middle, half = map(float, around.groups())
        low, high = max(middle - half, 0.0), middle + half
    elif between:
        low, high = map(float, between.groups())
    else:
        raise UsageError(f"--notch {text}: give a band in Hz, such as 31.4±0.5 or 30.9-31.9.")
    if not low < high:
        raise UsageError(f"--notch {text}: has no width; give a band in Hz, such as 31.4±0.5 or 30.9-31.9.")
    return low, high


def _run(requests: Any, settings: Any, jobs: int | None, dask: str | None) -> "list[FileReport]":
    from fltea.identification.run import identify_all
    from fltea.identification.workers import Here
    from fltea.recording.kind import is_of_this_process

    for one in (signal.SIGINT, signal.SIGTERM):
        signal.signal(one, _interrupt_once)
    workers = _workers(jobs, dask, len(requests))
    # Files are read in this process if a cluster may not see them, if one is a pipe, which no other process
    # can open, or if there is only one recording, which is read while the worker processes start.
    here = any(is_of_this_process(path) for one in requests for path in getattr(one, "paths", ()))
    readers = Here() if dask or len(requests) == 1 or here else None
    try:
        with progress_bar() as show:
            return identify_all(
                requests,
                settings,
                workers,
                readers,
                lambda text, done, total: show(text, completed=done, total=total),
            )
    finally:
        workers.close()


def _interrupt_once(number: int, frame: object) -> None:
    """End the run, and ignore further Ctrl-C, which would disturb the clean-up of a second or two."""
    for one in (signal.SIGINT, signal.SIGTERM):
        signal.signal(one, signal.SIG_IGN)
    raise KeyboardInterrupt


def _workers(jobs: int | None, dask: str | None, recordings: int = 0) -> "Workers":
    if dask is None:
        from fltea.identification.workers import open_local

        return open_local(jobs, recordings=recordings)

    if warning := trust_warning(dask):
        say(f"fltea: warning: {warning}")
    workers: Workers = load(
        "fltea.identification.dask_workers", "distributed", "dask", "--dask needs"
    ).DaskWorkers(dask)
    return workers


def _show(reports: "Sequence[FileReport]", *, details: bool) -> None:
    """Write tables to stdout; nothing if the only recording failed, since `_fail` reports that."""
    if len(reports) == 1 and reports[0].failure is not None:
        return
    from rich.console import Console

    from fltea.identification.terminal import show, summary

    text = io.StringIO()  # else rich would end the program if stdout cannot be written
    console = Console(file=text, force_terminal=sys.stdout.isatty() or None)
    for number, one in enumerate(reports):
        show(console, one, first=number == 0, details=details)
    if len(reports) > 1:
        summary(console, reports)
    print_result(text.getvalue())


def _fail(reports: "Sequence[FileReport]", files: Sequence[str], of_axes: Sequence[str]) -> None:
    """Report all failures and raise the first.

    `files`, `of_axes`: options in use that ask for files, and for figures of axes.
    """
    from fltea.identification.axis_report import Failure

    failures: list[FlteaError] = []
    for report in reports:
        if report.failure is not None:
            failures.append(report.failure)
        data_checks = report.recording.data_checks if report.recording else ()
        if unread := [data_check.text for data_check in data_checks if data_check.kind == "unread_file"]:
            failures.append(Incomplete(unread))
        failures += [
            UsageError(f"{report.name}: {name}: {axis.error}")
            for name, axis in report.axes.items()
            if isinstance(axis, Failure)
        ]
        failures += exports.withheld(report, files, of_axes)
    end_with(failures)
