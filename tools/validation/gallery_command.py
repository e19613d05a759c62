"""The part `gallery`."""

import signal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from fltea.cli.output import print_result, progress_bar, result_console, say, write_files

if TYPE_CHECKING:
    from tools.validation.gallery.run import Cell, Gallery, Seen

DEFAULT_OUT = Path("build/validation")
SEEN = "gallery.ndjson"
"""Holds each record as soon as it has been looked at."""


def gallery(
    series: Annotated[
        int, typer.Option(metavar="N", min=1, help="Records of each noise, rate and length.")
    ] = 1,
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TEXT",
            help="Only noises whose name has this in it, such as relaxation; may be given again.",
            show_default=False,
        ),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Only 10 min at 100 Hz: half a minute.")] = False,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume", help="Keep what an earlier run of the same program left in DIR, and do the rest."
        ),
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            help="Processes, of up to 2 GB each; the default is one a processor.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="For gallery.json, gallery.md and the pictures.")
    ] = DEFAULT_OUT,
    no_figures: Annotated[
        bool, typer.Option("--no-figures", help="No pictures; then matplotlib is not needed.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print gallery.json, and nothing else, on stdout.")
    ] = False,
) -> None:
    """Try the verdicts of `fltea identify` on noises whose truth is known.

    White noise of several kinds, relaxations over one to five decades, fractional orders, 1/f, low-passes of
    chips, resonances, lines, hum, rounding, outliers, drift, noises that change, and badly read sensors; each
    for 30 s, 10 min and 3 h at 5, 100 and 1,000 Hz. They are drawn by recursions that share no code with the
    fits. Which verdicts are right on a record follows from the true spectrum, the rate and the length: where
    another kind of noise has the same spectrum as far as the record goes, its name is right as well; where
    chance decides, saying less is accepted as "cannot be told", with the reason. All else is wrong.

    The table shows the wrong ones. Below it: how many verdicts are right, how many records of noises without
    an order are called fractional (at most 2 % should be), and how many claims of an order have a sum of
    relaxations within 6 in 2 log L (none should).

    The same arguments give the same records. A whole run with one record a cell takes a quarter of an hour on
    two processors. What came out, and what to make of it: host/docs/evaluation/gallery.md.

    For example:

        make validate ARGS=gallery --quick

        make validate ARGS=gallery --only relaxation --only 1/f --series 5

        make validate ARGS=gallery --series 3 --resume --out build/gallery-3
    """
    from fltea.lab.reproduce.request import prepare_folder
    from fltea.settings.extras import need_matplotlib

    from tools.validation.gallery.run import LENGTHS_S, QUICK, RATES_HZ, cells

    names = _names(only)
    if not no_figures:
        need_matplotlib("pictures need", "; without it, ask for the tables alone: --no-figures")
    prepare_folder(out)
    rates, lengths = ((QUICK[0],), (QUICK[1],)) if quick else (RATES_HZ, LENGTHS_S)
    wanted = cells(series, names, rates, lengths)
    result = _run(wanted, jobs, out / SEEN, resume=resume)
    files = _write(result, out, figures=not no_figures)
    if as_json:
        from tools.validation.gallery.table import to_json

        print_result(to_json(result).decode())
    else:
        _show(result)
    say(f"validation: {len(files)} files in {out}")


def _names(only: list[str] | None) -> list[str]:
    from fltea.records.errors import UsageError

    from tools.validation.gallery.noises import NOISES

    for text in only or ():
        if not any(text in name for name in NOISES):
            raise UsageError(f"--only {text}: no noise has this in its name; they are: {', '.join(NOISES)}.")
    return [name for name in NOISES if only is None or any(text in name for text in only)]


def _run(wanted: "list[Cell]", jobs: int | None, kept: Path, *, resume: bool) -> "Gallery":
    import msgspec
    from fltea.identification.workers import open_local

    from tools.validation.gallery.run import visit

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    known = _known(kept) if resume else []
    workers = open_local(jobs)
    try:
        with kept.open("ab" if resume else "wb") as file, progress_bar(len(wanted)) as advance:

            def keep(seen: "Seen") -> None:
                file.write(msgspec.json.encode(seen) + b"\n")
                file.flush()

            there = set(wanted)
            known = [one for one in known if one.cell in there]
            advance("", len(known))
            return visit(wanted, workers, known=known, keep=keep, progress=lambda text: advance(text, 1))
    finally:
        workers.close()


def _known(kept: Path) -> "list[Seen]":
    """What an earlier run left; a last line that was cut off is done again."""
    import msgspec
    from fltea.records.errors import UsageError

    from tools.validation.gallery.run import Seen

    if not kept.exists():
        return []
    lines = kept.read_bytes().split(b"\n")
    whole, rest = lines[:-1], lines[-1]
    if rest:
        kept.write_bytes(b"".join(line + b"\n" for line in whole))
    try:
        return [msgspec.json.decode(line, type=Seen) for line in whole]
    except msgspec.MsgspecError as error:
        raise UsageError(
            f"--resume: {kept} is not of this program ({error}); without --resume it is made again."
        ) from error


def _write(result: "Gallery", folder: Path, *, figures: bool) -> list[Path]:
    from tools.validation.gallery.pictures import draw_all
    from tools.validation.gallery.table import markdown, to_json

    contents = {"gallery.json": to_json(result), "gallery.md": markdown(result).encode()}
    if figures:
        contents |= {f"gallery_{name}.png": data for name, data in draw_all(result).items()}
    return write_files(folder, contents)


def _show(result: "Gallery") -> None:
    """The wrong ones and the figures that count on stdout."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    from tools.validation.gallery import table

    with result_console() as console:
        rows = table.wrong_rows(result)
        if rows:
            drawn = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
            for heading in table.HEADINGS:
                drawn.add_column(heading)
            for row in rows:
                drawn.add_row(*(Text(cell) for cell in row))
            console.print(drawn)
        for sentence in table.summary(result):
            console.print(Text(sentence))
