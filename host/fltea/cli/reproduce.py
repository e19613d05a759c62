"""The commands `fltea reproduce` and `fltea bench`."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from fltea.cli.option_groups import takes_groups
from fltea.cli.output import AsJson, escaped, print_result, progress_bar, say
from fltea.cli.setting_flags import takes_settings
from fltea.records.errors import UsageError
from fltea.settings.config import load_config

if TYPE_CHECKING:
    from fltea.lab.reproduce.request import Request
    from fltea.lab.reproduce.runs import Options
    from fltea.lab.reproduce.scenarios import SawTooth

DEFAULT_SEEDS = 1000
READINGS_SEEDS = 32


@dataclass(frozen=True)
class WantedOptions:
    """Which tables and figures of the paper are made, and with how many runs of each experiment."""

    table: Annotated[
        list[str] | None,
        typer.Option("--table", "-t", metavar="N", help="A table, 1 to 5, or 6.2; repeatable."),
    ] = None
    figure: Annotated[
        list[str] | None,
        typer.Option("--figure", metavar="N", help="A figure, 2 to 10, 12 to 20, or 6.2; repeatable."),
    ] = None
    seeds: Annotated[
        int | None,
        typer.Option(
            metavar="S",
            min=1,
            help=f"Runs of each experiment. [default: {DEFAULT_SEEDS}; with --readings {READINGS_SEEDS}]",
            show_default=False,
        ),
    ] = None


@dataclass(frozen=True)
class FilterOptions:
    """Which form of the paper's algorithm runs."""

    variant: Annotated[
        Literal["triple", "joint"], typer.Option(help="`triple` is the paper's algorithm.")
    ] = "triple"
    guard: Annotated[
        Literal["off", "faithful", "consistent"],
        typer.Option(help="`off` is the algorithm as the paper prints it, which can diverge."),
    ] = "off"
    memory: Annotated[
        Literal["direct", "compressed"],
        typer.Option(
            help="`direct` is exact; `compressed` is faster, and the same to six digits for orders up to 4."
        ),
    ] = "direct"

    def options(self) -> "Options":
        """Return these options in the form in which the engine takes them."""
        from fltea.lab.reproduce.runs import Options

        return Options(self.variant, self.guard, self.memory)


@dataclass(frozen=True)
class DataOptions:
    """The folder for the results, and the data with which the experiments run."""

    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder for PNGs, tables.md and a CSV per table. [default: fltea-reproduce if figures are "
            "made; otherwise no files are written]",
        ),
    ] = None
    recording: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Recording of a resting gyroscope for table 5 and figures 12 to 20."
        ),
    ] = None
    amplitude: Annotated[float, typer.Option(help="Amplitude of the saw-tooth in examples 1 and 2.")] = 1.0
    period: Annotated[float, typer.Option(metavar="S", help="Period of the saw-tooth in seconds.")] = 1.0
    unipolar: Annotated[
        bool, typer.Option("--unipolar", help="The saw-tooth rises from 0, not from -amplitude.")
    ] = False

    def sawtooth(self) -> "SawTooth":
        """Return the saw-tooth of examples 1 and 2."""
        from fltea.lab.reproduce.scenarios import SawTooth

        return SawTooth(self.amplitude, self.period, self.unipolar)


@dataclass(frozen=True)
class StudyOptions:
    """Two studies of our own, of which one can be computed in place of the paper's tables and figures."""

    score: Annotated[
        bool,
        typer.Option(
            "--score", help="Score the guards instead, on the examples and on every kind of bad input."
        ),
    ] = False
    readings: Annotated[
        bool,
        typer.Option(
            "--readings",
            help="Show instead how each choice that the paper leaves open changes tables 2 to 4; it takes a "
            f"minute for {READINGS_SEEDS} seeds.",
        ),
    ] = False


@takes_settings(["replay.columns", "replay.units", "replay.rate_hz"], only=())
@takes_groups
def reproduce(
    settings: dict[str, Any],
    wanted: WantedOptions,
    filters: FilterOptions,
    data: DataOptions,
    study: StudyOptions,
    as_json: AsJson = False,
) -> None:
    """Run the paper's experiments again: tables next to the paper's numbers, figures as PNG.

    Without --table and --figure, all tables and figures are made. The paper states neither amplitude nor
    period of the saw-tooth; fltea uses ±1 at 1 Hz. Without --recording, the gyroscope's figures are made from
    white noise with the paper's R.

    A run is not finite if an estimate becomes infinite or NaN. A run is far off if it stays finite, but the
    order once leaves ±10, or the state is once wrong by more than 10 √R. Both kinds of runs are counted.
    Medians and 5–95 % ranges are of all finite runs, including those that are far off.

    The paper's tables 2 to 4 show errors of the estimates. Each error is printed with its percentile: the
    percentage of our finite runs whose error is smaller. Percentiles are also printed for the change of each
    error from memory length L = 4,000 to the shortest L. Tables 3 and 4 are each compared with example 2 and
    with example 3, since they seem to be exchanged in the paper. The evidence for this is shown, but it
    remains an inference.

    For example:

        fltea reproduce --table 2 --seeds 100

        fltea reproduce --table 3 --table 4

        fltea reproduce --readings --seeds 80

        fltea reproduce --table 3 --guard consistent --amplitude 5 --json

        fltea reproduce --score --memory compressed

        fltea reproduce --table 5 --figure 13 --recording rest.npz --out figures
    """
    is_chosen = wanted.table or wanted.figure
    if study.score:
        if is_chosen or data.out or data.recording or study.readings:
            raise UsageError(
                "--score has its own cases; it goes with --seeds, --variant, --memory and --json."
            )
        _score(wanted.seeds or DEFAULT_SEEDS, filters.options(), as_json)
    elif study.readings:
        if is_chosen or (filters, data) != (FilterOptions(), DataOptions()):
            raise UsageError("--readings has its own cases; it goes with --seeds and --json.")
        _readings(wanted.seeds or READINGS_SEEDS, as_json)
    else:
        _report(_request(settings, wanted, filters, data), as_json)


def _request(
    settings: dict[str, Any],
    wanted: WantedOptions,
    filters: FilterOptions,
    data: DataOptions,
) -> "Request":
    from fltea.lab.reproduce.request import Request, select

    tables, figures, everything = select(wanted.table or [], wanted.figure or [])
    if data.recording is None and settings:
        raise UsageError("--columns, --units and --rate describe a recording; name it with --recording.")
    return Request(
        tables=tables,
        figures=figures,
        seeds=wanted.seeds or DEFAULT_SEEDS,
        options=filters.options(),
        sawtooth=data.sawtooth(),
        recording=data.recording,
        how=load_config(None, settings).replay.how,
        out=data.out,
        everything=everything,
    )


def _report(request: "Request", as_json: bool) -> None:
    from fltea.lab.reproduce.report import Report

    report = Report(request)
    with progress_bar(report.steps) as show:
        report.progress = lambda text, steps: show(text, advance=steps)
        rows = report.run()
    evidence = report.exchange()
    if as_json:
        _print_json({"tables": rows} | ({} if evidence is None else {"exchange": evidence}))
    else:
        print_result(report.document(rows) if rows else "")
    if report.files:
        say(f"fltea: {len(report.files)} files in {request.folder}")


def _score(seeds: int, options: "Options", as_json: bool) -> None:
    from fltea.lab.reproduce.score import document, score, steps

    with progress_bar(steps(seeds)) as show:
        rows = score(seeds, options, lambda text, done: show(text, advance=done))
    if as_json:
        _print_json({"score": rows})
    else:
        print_result(document(rows))


def _readings(seeds: int, as_json: bool) -> None:
    from fltea.lab.reproduce.open_choices import compare, document, steps

    with progress_bar(steps(seeds)) as show:
        rows = compare(seeds, lambda text, done: show(text, advance=done))
    if as_json:
        _print_json({"readings": rows})
    else:
        print_result(document(rows))


def _print_json(result: dict[str, Any]) -> None:
    print_result(escaped(json.dumps(result, ensure_ascii=False, allow_nan=False)) + "\n")


def bench(
    what: Annotated[str, typer.Argument(metavar="estimator", help="What to measure.")],
    as_json: AsJson = False,
    repetitions: Annotated[
        int, typer.Option(min=1, help="Repetitions of every measurement; medians are shown.")
    ] = 5,
) -> None:
    """Measure how fast this machine is: engine, numpy reference and filterpy's UKF side by side on one core.

    For example:

        fltea bench estimator --json
    """
    if what != "estimator":
        raise UsageError(f"bench {what}: there is only 'estimator'.")
    from fltea.lab import bench as bench_estimator

    result = bench_estimator.measure(repetitions)
    print_result((json.dumps(result, allow_nan=False) if as_json else bench_estimator.text(result)) + "\n")
