"""`make validate`: measure verdicts, fits and filters on noises whose true parameters are known.

  make validate ARGS='gallery --quick'                     half a minute
  make validate ARGS='gallery --only 1/f --seeds 5'        some noises, five records of each
  make validate ARGS='gallery --first 1 --against build/validation/gallery.ndjson --out build/now'
  make validate ARGS='evaluate --seeds 100'
  make validate ARGS='all --resume'                        goes on where a run was stopped: hours

The same arguments give the same files. For each part, the output folder gets PART.ndjson (all figures, one
line for each task as soon as it is done), PART.md (the tables) and pictures.
"""

import argparse
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from fltea.cli.output import print_result, result_console, say, write_files
from fltea.identification.workers import open_local
from fltea.records.errors import FlteaError, UsageError
from fltea.records.whole_file import prepare_folder
from fltea.settings.extras import need_matplotlib

from tools.validation.runner import Options, read_rows, run
from tools.validation.tables import Table

PARTS = {
    "gallery": ("gallery.records", "verdicts on known noises at three sample rates and three lengths"),
    "growth": ("gallery.growth", "verdicts on the gallery's noises as their records grow"),
    "coverage": ("coverage.run", "how often each published interval contains the true value"),
    "allan": ("allan", "Allan deviations of models: computed ones and simulated ones"),
    "evaluate": ("evaluate.run", "how accurate the live fit and the filters are, for each noise"),
    "odds": ("odds.run", "how reliable the odds of an order are, and how many orders they find"),
    "states": ("states", "how accurate the tracker's bias is, compared with a filter that knows the noise"),
    "bias": (
        "bias.run",
        "how accurate the bias is after a step or a turn, compared with VQF and imufusion",
    ),
    "forecast": (
        "forecast",
        "how often a heading is inside its band, and how often a right model is rejected",
    ),
    "navigation": ("navigation", "how accurate a Kalman filter with the figures of --gauss-markov is"),
    "power": ("power", "how often the null test of `identify` rejects white and other noise"),
    "anytime": ("anytime", "how often white noise gets another verdict within a day"),
    "bound": ("bound", "critical values of intervals for noises without white noise"),
    "device": ("device", "how much the board's estimates and fits differ from the host's"),
    "fleet": ("fleet", "how often `fltea fleet` calls healthy sensors odd"),
}
"""The parts that can be run: modules of this folder, with a short description of each.

Each module defines SEEDS and QUICK_SEEDS, `tasks` (the tasks for some options) and `tables` (the tables made
of the result rows). It may define `pictures` of the rows, and `compared`, which makes tables of the rows of
two runs.
"""


def main() -> int:
    """Run the named parts.

    If a failure is of an expected kind, print one line on stderr and return an exit code.
    """
    given = _arguments()
    try:
        if not given.no_figures:
            need_matplotlib("pictures need", "; --no-figures makes only the tables, without it")
        prepare_folder("--out", given.out)
        for part in PARTS if given.part == ["all"] else given.part:
            _run(part, given)
    except FlteaError as error:
        say(f"validation: error: {error}")
        return error.exit_code
    except KeyboardInterrupt:
        return 130
    return 0


def _run(part: str, given: argparse.Namespace) -> None:
    module: Any = import_module(f"tools.validation.{PARTS[part][0]}")
    seeds = given.seeds or (module.QUICK_SEEDS if given.quick else module.SEEDS)
    tasks = module.tasks(Options(seeds, given.quick, tuple(given.only), given.first, given.hours))
    if not tasks:
        raise UsageError(f"{part}: no name contains {' or '.join(given.only)}.")
    before = read_rows(given.against) if given.against is not None else []
    workers = open_local(given.jobs)
    try:
        file = given.out / f"{part}.ndjson"
        rows = run(tasks, workers, file, resume=given.resume)
    finally:
        workers.close()
    tables: list[Table | str] = module.tables(rows)
    if given.against is not None:
        tables += module.compared(before, rows)
    texts = [one.markdown() if isinstance(one, Table) else one + "\n" for one in tables]
    contents = {f"{part}.md": "\n".join(texts).encode()}
    if not given.no_figures and hasattr(module, "pictures"):
        contents |= {f"{part}_{name}.png": data for name, data in module.pictures(rows).items()}
    files = [file, *write_files(given.out, contents)]
    if given.json:
        print_result(file.read_text(encoding="utf-8"))
    else:
        with result_console() as console:
            for one in tables:
                if isinstance(one, str):
                    console.print(one, markup=False)
                elif one.brief:
                    console.print(one.drawn())
    say(f"validation: {len(files)} files of {part} in {given.out}")


def _arguments() -> argparse.Namespace:
    parts = "".join(f"  {name:<10} {what}\n" for name, (_, what) in PARTS.items())
    parser = argparse.ArgumentParser(
        "python -m tools.validation",
        description=f"{__doc__}\nparts:\n{parts}  all        all parts, one after the other",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("part", nargs="+", choices=[*PARTS, "all"], metavar="PART")
    parser.add_argument("--quick", action="store_true", help="measure less, in a minute or less")
    parser.add_argument(
        "--seeds", type=_positive, metavar="N", help="number of series, records or axes of each kind"
    )
    parser.add_argument(
        "--only", action="append", default=[], metavar="TEXT", help="only names that contain TEXT; repeatable"
    )
    parser.add_argument(
        "--first", type=int, default=0, metavar="K", help="only for gallery: number of the first record"
    )
    parser.add_argument(
        "--hours",
        type=_positive,
        default=0,
        metavar="H",
        help="only for bias: hours of each noise in which false steps are counted",
    )
    parser.add_argument(
        "--against",
        type=Path,
        metavar="FILE",
        help="only for gallery: compare each cell with this gallery.ndjson",
    )
    parser.add_argument(
        "--resume", action="store_true", help="skip tasks that an earlier run has finished in DIR"
    )
    parser.add_argument(
        "--jobs", type=_positive, metavar="N", help="number of processes; default: one for each processor"
    )
    parser.add_argument("--out", type=Path, default=Path("build/validation"), metavar="DIR")
    parser.add_argument(
        "--no-figures", action="store_true", help="draw no pictures; matplotlib is not needed then"
    )
    parser.add_argument("--json", action="store_true", help="print PART.ndjson instead of tables")
    given = parser.parse_args()
    if given.against is not None and given.part != ["gallery"]:
        parser.error("--against works only with the part gallery")
    return given


def _positive(text: str) -> int:
    if int(text) < 1:
        raise ValueError
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
