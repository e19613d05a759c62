"""The command `make validate`."""

import signal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from fltea.cli.output import print_result, progress_bar, result_console, say, write_files

if TYPE_CHECKING:
    from tools.validation.evaluate.run import Plan, Result

DEFAULT_SEEDS = 20
QUICK_SEEDS = 10
"""Of fewer, all intervals have to hold the truth for it to be called right: 95 % of them rarely do."""
DEFAULT_OUT = Path("build/validation")


def evaluate(
    seeds: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=2,
            help=f"Series of each noise, four times as many for the fits: {DEFAULT_SEEDS}, with --quick "
            f"{QUICK_SEEDS}, if not given.",
            show_default=False,
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Five noises of 3,000 and 20,000 samples: seconds.")
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Processes; the default is one a processor.", show_default=False
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="For evaluation.json, evaluation.csv and the heat maps.")
    ] = DEFAULT_OUT,
    no_figures: Annotated[
        bool, typer.Option("--no-figures", help="No heat maps; then matplotlib is not needed.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print evaluation.json, and nothing else, on stdout.")
    ] = False,
) -> None:
    """Judge the live figures, fit and filters, on noises whose α and f are known.

    Every noise is y = x + v with D^α x = f x + ω, stationary, with unlimited memory, at 100 Hz and with the
    variance of the paper's gyroscope. `live` is the maximum-likelihood fit of what the daemon keeps, Whittle
    the same of the whole record, and the Cramér–Rao bound the least spread of any estimator without bias. On
    a few noises the exact Gaussian likelihood is the referee of both. `triple` and `joint` run as the daemon
    runs them: start-up window, its bias and R, Q = 0.15, guard consistent; then tuned by the live fit; and
    with what is true. White noise is one of the noises; false alarms of the null test are counted on three
    kinds of it. Noises that change in mid-run, knocks and drift follow, then a smaller table with one setting
    changed at a time.

    Of each: bias, spread, root mean square error, the estimator's own σ, the share of its 95 % intervals that
    hold the truth, and how often there is no value. A figure is *right* where the error of α is up to 0.1,
    90 % of the intervals hold it (then σ is *honest*), and 90 % of the series have a value. A fit has none
    where its null test does not reject white noise. In a heat map grey is none in half of them or more.

    The same arguments give the same files. All of it takes some eight minutes on two processors, twice the
    seeds twice as long. What came out, and what to make of it: host/docs/evaluation/live.md.

    For example:

        make validate --quick

        make validate --seeds 100 --out build/validation-100

        make validate --quick --no-figures --json > quick.json
    """
    from fltea.lab.reproduce.request import prepare_folder
    from fltea.settings.extras import need_matplotlib

    from tools.validation.evaluate.run import full_plan, quick_plan

    if not no_figures:
        need_matplotlib("heat maps need", "; without it, ask for numbers alone: --no-figures")
    prepare_folder(out)
    plan = quick_plan(seeds or QUICK_SEEDS) if quick else full_plan(seeds or DEFAULT_SEEDS)
    result = _run(plan, jobs)
    files = _write(result, out, figures=not no_figures)
    if as_json:
        from tools.validation.evaluate.summaries import to_json

        print_result(to_json(result).decode())
    else:
        _show(result)
    say(f"validation: {len(files)} files in {out}")


def _run(plan: "Plan", jobs: int | None) -> "Result":
    from fltea.identification.workers import open_local

    from tools.validation.evaluate.run import evaluate as run
    from tools.validation.evaluate.run import steps

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    workers = open_local(jobs)
    try:
        with progress_bar(steps(plan)) as advance:
            return run(plan, workers, lambda text: advance(text, 1))
    finally:
        workers.close()


def _write(result: "Result", folder: Path, *, figures: bool) -> list[Path]:
    from tools.validation.evaluate.figures import draw
    from tools.validation.evaluate.summaries import to_csv, to_json

    contents = {"evaluation.json": to_json(result), "evaluation.csv": to_csv(result).encode()}
    if figures:
        contents |= {f"evaluation_{name}.png": data for name, data in draw(result).items()}
    return write_files(folder, contents)


def _show(result: "Result") -> None:
    """Tables and the conclusion on stdout."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    from tools.validation.evaluate import fit_summaries, summaries

    with result_console() as console:
        for headings, rows in (
            fit_summaries.errors(result),
            (fit_summaries.RATIO_HEADINGS, fit_summaries.ratios(result)),
            (fit_summaries.COVERAGE_HEADINGS, fit_summaries.coverages(result)),
            (fit_summaries.HELD_HEADINGS, fit_summaries.held(result)),
            (fit_summaries.REFEREE_HEADINGS, fit_summaries.referee(result)),
            (fit_summaries.ALARM_HEADINGS, fit_summaries.alarms(result)),
            (fit_summaries.SHIFT_HEADINGS, fit_summaries.shifts(result)),
            (summaries.SUMMARY_HEADINGS, summaries.summary(result)),
            (summaries.WHITE_HEADINGS, summaries.white(result)),
            (summaries.CHANGE_HEADINGS, summaries.changes(result)),
        ):
            table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
            table.add_column(headings[0], no_wrap=True)
            for heading in headings[1:]:
                table.add_column(heading, justify="right")
            for row in rows:
                table.add_row(*row)
            console.print(table)
        console.print(Text(summaries.conclusion(result)))
