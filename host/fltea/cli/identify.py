"""The command `fltea identify`: it makes requests from flags, and prints the results."""

import io
import json
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fltea.cli import exports, many
from fltea.cli.identify_options import (
    ExportOptions,
    QuestionOptions,
    Recordings,
    ShownOptions,
    Table,
    WorkerOptions,
)
from fltea.cli.option_groups import flags_in_use, takes_groups
from fltea.cli.output import end_with, escaped, print_result, progress_bar, say
from fltea.cli.setting_flags import FILTERS, RECORDING, takes_settings
from fltea.identification.dask_address import trust_warning
from fltea.process.interrupted import Interrupted
from fltea.records.errors import FlteaError, Incomplete, UsageError
from fltea.records.whole_file import prepare_folder
from fltea.settings.extras import load

if TYPE_CHECKING:
    from fltea.identification.axis import IdentifyOptions
    from fltea.identification.axis_report import FileReport
    from fltea.identification.forecast import Asked
    from fltea.identification.load import Request, Unreadable
    from fltea.identification.settings import Settings
    from fltea.identification.workers import Workers
    from fltea.settings.config import Config


@takes_settings(["channels", *FILTERS, *RECORDING], of_both=True)
@takes_groups
def identify(
    settings: dict[str, Any],
    files: Recordings,
    shown: ShownOptions,
    questions: QuestionOptions,
    export: ExportOptions,
    work: WorkerOptions,
    out: Table = None,
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
    many.check(files, out, _flags_of_one(shown, questions, export))
    work.check()
    part, asked, program = questions.part(), questions.asked(), export.program()
    if program is not None and (shown.as_json or shown.details):
        raise UsageError("--for prints its lines and nothing else: leave --json and --details out.")
    config = _config(shown.config, settings)
    options = questions.of_each_axis()
    if out is not None:
        _identify_to_table(files, out, options, config, work)
        return
    exported = export.files()
    exported.check(files, shown.config)
    if shown.report is not None:
        prepare_folder("--report", shown.report)
    requests = _requests(files, config, accel=export.has_both_sensors)
    exported.check([path for one in requests for path in getattr(one, "paths", ())], shown.config)
    for_one = [*exported.flags, *flags_in_use(export, "for_program")]
    if len(requests) > 1 and for_one:
        raise UsageError(f"{', '.join(for_one)}: only for a single recording; you gave {len(requests)}.")
    forecast = asked or exported.inflation == "auto"
    reports = _run(requests, _settings(options, config, shown, forecast=forecast), work)
    if part is not None:
        for report in reports:
            report.compare_with(part)
    # Results are printed before files are written, so that a file that cannot be written does not cost the
    # results of minutes of computing.
    if program is not None:
        print_result(exports.lines_for(reports[0], *program, exported.inflation))
    else:
        _print(reports, shown)
    _write_page(reports, shown.report)
    exports.write(reports[0], exported)
    _fail(reports, exported.flags, questions.flags)


def _flags_of_one(shown: ShownOptions, questions: QuestionOptions, export: ExportOptions) -> list[str]:
    """Return the given flags that work only for one recording or a few.

    They cannot be combined with --out, which writes a table.
    """
    return [
        *flags_in_use(shown, "as_json", "report"),
        *flags_in_use(export, "export_model", "imu_yaml", "gauss_markov", "allan_csv"),
        *flags_in_use(questions, "sheet"),
        *flags_in_use(export, "for_program"),
        *flags_in_use(questions, "drive_for"),
    ]


def _config(path: Path | None, settings: dict[str, Any]) -> "Config":
    from fltea.settings.config import load_configs

    configs = load_configs(path, settings)
    if len(configs) > 1:
        raise UsageError(
            f"{path}: has settings of several devices; give a file without [device] tables, or --set."
        )
    return configs[0]


def _channels(config: "Config") -> tuple[str, ...] | None:
    return tuple(config.channels) if config.channels else None


def _identify_to_table(
    files: list[str], out: Path, options: "IdentifyOptions", config: "Config", work: WorkerOptions
) -> None:
    from fltea.cluster.whole import Ask
    from fltea.identification.settings import Settings

    ask = Ask(
        Settings(options, config.estimator, config.accel, live=config.live),
        _channels(config),
        config.replay.how,
        config.replay.limits,
    )
    many.identify_many(files, out, ask, lambda: _workers(work.jobs, work.dask))


def _requests(files: list[str], config: "Config", *, accel: bool) -> "list[Request | Unreadable]":
    from fltea.identification.load import Request, Unreadable, recordings

    channels, replay = _channels(config), config.replay
    return [
        recording
        if isinstance(recording, Unreadable)
        else Request(recording, channels, replay.how, replay.limits, accel=accel)
        for recording in recordings([Path(file) for file in files])
    ]


def _settings(
    options: "IdentifyOptions", config: "Config", shown: ShownOptions, *, forecast: "Asked"
) -> "Settings":
    from fltea.identification.settings import Settings

    return Settings(
        options,
        config.estimator,
        config.accel,
        details=shown.needs_details,  # details are computed only if the output shows them
        figures=shown.report is not None,
        forecast=forecast,
        live=config.live,
    )


def _print(reports: "Sequence[FileReport]", shown: ShownOptions) -> None:
    if not shown.as_json:
        _show(reports, details=shown.details)
        return
    from fltea.identification import findings

    text = json.dumps(findings.document(reports), ensure_ascii=False, allow_nan=False)
    print_result(escaped(text) + "\n")


def _write_page(reports: "Sequence[FileReport]", folder: Path | None) -> None:
    if folder is None:
        return
    from fltea.identification import report as page

    if written := page.write(folder, reports):
        say(f"fltea: wrote {written[0]} and {len(written) - 1} pictures")


def _run(
    requests: "Sequence[Request | Unreadable]", settings: "Settings", work: WorkerOptions
) -> "list[FileReport]":
    from fltea.identification.run import identify_all
    from fltea.identification.workers import Here
    from fltea.recording.kind import is_of_this_process

    for one in (signal.SIGINT, signal.SIGTERM):
        signal.signal(one, _interrupt_once)
    workers = _workers(work.jobs, work.dask, len(requests))
    # Files are read in this process in three cases: if a cluster may not see them; if one of them is a pipe,
    # which no other process can open; or if there is only one recording, which is then read while the worker
    # processes start.
    here = any(is_of_this_process(path) for one in requests for path in getattr(one, "paths", ()))
    readers = Here() if work.dask or len(requests) == 1 or here else None
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
    """End the run. Ignore further Ctrl-C, since they would disturb the clean-up of a second or two."""
    for one in (signal.SIGINT, signal.SIGTERM):
        signal.signal(one, signal.SIG_IGN)
    raise Interrupted(number)


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
    """Write the results as tables to stdout.

    Write nothing if the only recording failed, since `_fail` reports the failure.
    """
    if len(reports) == 1 and reports[0].failure is not None:
        return
    from rich.console import Console

    from fltea.identification.terminal import show, summary

    # The text is collected first, since rich would end the program if it could not write to stdout.
    text = io.StringIO()
    console = Console(file=text, force_terminal=sys.stdout.isatty() or None)
    for number, one in enumerate(reports):
        show(console, one, first=number == 0, details=details)
    if len(reports) > 1:
        summary(console, reports)
    print_result(text.getvalue())


def _fail(reports: "Sequence[FileReport]", files: Sequence[str], of_axes: Sequence[str]) -> None:
    """Report all failures and raise the first.

    `files`: the user's flags that ask for files. `of_axes`: the user's flags that ask for figures of axes.
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
