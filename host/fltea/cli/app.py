"""The command line: all commands of `fltea`, and their exit codes."""

import atexit
import contextlib
import gc
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from fltea.cli import standard_output
from fltea.cli.devices import devices, doctor
from fltea.cli.flash import flash
from fltea.cli.fleet import fleet
from fltea.cli.identify import identify
from fltea.cli.output import print_lines, say
from fltea.cli.record import export, info, record, recover
from fltea.cli.reproduce import bench, reproduce
from fltea.cli.run import run
from fltea.records.errors import FlteaError, UsageError, of_input
from fltea.records.scarce import check_address_space, is_scarcity, scarcity
from fltea.records.secret import refuse_secrets
from fltea.records.version import __version__
from fltea.records.whole_file import check_outputs
from fltea.wire import layout as wire

EXIT_CODES = (
    "Exit codes: 0: ended as asked. 1: failed while running. 2: the command line, the configuration or an "
    "input file is wrong. 130, 143: interrupted by Ctrl-C or SIGTERM before the end."
)
ENDED_BY_CTRL_C = (
    "Exit codes: 0: ended as asked, also by Ctrl-C or SIGTERM. 1: failed while running. 2: the command line, "
    "the configuration or an input file is wrong. 130, 143: interrupted by Ctrl-C or SIGTERM before it had "
    "begun."
)
"""Exit codes of commands that go on until they are ended."""

HELP = ["-h", "--help"]

app = typer.Typer(
    name="fltea",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help=(
        "Identify the noise of a gyroscope at rest, live or from a recording: what it is made of, order α "
        "and parameter f with intervals, the bias now, and the heading error to expect. Begin with "
        "`fltea identify FILE` or `fltea run`; `fltea doctor` helps when something fails."
    ),
    epilog=EXIT_CODES,
    context_settings={"help_option_names": HELP},
)


def main() -> None:
    """Run the command. Every expected failure gives one line on stderr and an exit code."""
    # All matrices are small. OpenBLAS's threads would only wait in a loop, which takes 1.5 % of a core.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if not os.environ.get("COLUMNS", "1").strip("0"):
        # A terminal that does not know its width states 0. With this width nothing would be printed.
        del os.environ["COLUMNS"]
    gc.freeze()  # the loaded modules are never freed, so the garbage collector need not search them
    # without this, the interpreter would search all objects for cycles at exit, which takes 40 ms
    atexit.register(gc.freeze)
    standard_output.occupy_closed()
    try:
        standard_output.prepare()
        refuse_secrets(sys.argv[1:])
        if not {*sys.argv[1:]} & {*HELP, "--version"}:
            check_address_space()
        try:
            app()
        except SystemExit:
            standard_output.finish()
            raise
    except KeyboardInterrupt:
        sys.exit(130)
    except standard_output.OutputFailed as error:
        standard_output.silence_stdout()
        say(f"fltea: error: {error.as_failure()}")
        sys.exit(FlteaError.exit_code)
    except Exception as error:
        failure = error if isinstance(error, FlteaError) else _failure(error)
        if failure is None or (failure is not error and sys.flags.dev_mode):
            raise
        say(f"fltea: error: {failure}")
        with contextlib.suppress(standard_output.OutputFailed):
            standard_output.finish()
        sys.exit(failure.exit_code)


def _failure(error: Exception) -> FlteaError | None:
    return scarcity(error) if is_scarcity(error) else of_input(error)


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"fltea {__version__}, protocol {wire.PROTOCOL_MAJOR}.{wire.PROTOCOL_MINOR}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    pass


def inspect(
    source: Annotated[
        str,
        typer.Argument(
            metavar="FILE|PORT|-", help="Raw frames: a file, a serial port or URL, or - for stdin."
        ),
    ],
    baud: Annotated[int, typer.Option(help="Serial speed.")] = wire.BAUD,
    limit: Annotated[int, typer.Option(metavar="N", help="Stop after N lines; 0: never.")] = 0,
) -> None:
    """Show raw frames of the wire protocol, one line each, damaged ones with the reason.

    For example:

        fltea inspect /dev/ttyACM0 --limit 20

        fltea inspect capture.bin
    """
    from fltea.wire.block_reader import FrameReader
    from fltea.wire.inspection import inspect as inspect_frames
    from fltea.wire.inspection import summary

    reader = FrameReader()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with contextlib.suppress(KeyboardInterrupt):
            for number, line in enumerate(inspect_frames(_chunks(source, baud), reader), 1):
                print_lines(line)
                if number == limit:
                    break
        print(summary(reader), flush=True)
    except BrokenPipeError:
        standard_output.silence_stdout()
        return
    if not reader.counts["frames"]:
        raise FlteaError(
            f"{source}: not one valid frame. Is it raw output of the firmware, at the right baud rate?"
        )


def _chunks(source: str, baud: int) -> Iterator[bytes]:
    if source == "-":
        while chunk := os.read(sys.stdin.fileno(), 1 << 16):
            yield chunk
        return
    path = Path(source)
    if path.is_dir():
        raise UsageError(f"{source}: is a directory.")
    if path.is_file():
        try:
            with path.open("rb") as file:
                while chunk := file.read(1 << 16):
                    yield chunk
        except OSError as error:
            raise UsageError(f"{source}: cannot be read ({error}).") from error
        return
    if "://" not in source and not path.exists() and not source.startswith("/dev/"):
        raise UsageError(f"{source}: there is no such file or port.")
    yield from _serial_chunks(source, baud)


def _serial_chunks(source: str, baud: int) -> Iterator[bytes]:
    from fltea.records.events import Chunk, Failed
    from fltea.wire.reader import Reader
    from fltea.wire.transport import Port

    port = Reader(Port(source.removeprefix("serial:"), baud))
    port.start()
    try:
        for event in port.events(0.5):
            if isinstance(event, Failed):
                raise FlteaError(event.message)
            if isinstance(event, Chunk):
                yield event.data
    finally:
        port.close()


GIVEN_BY_MODEL = ("alpha", "alpha_end", "f", "q", "r", "rate", "axes", "window")
"""Flags of `simulate` that --model replaces."""


def simulate(
    context: typer.Context,
    out: Annotated[Path, typer.Argument(metavar="FILE.csv|FILE.npz", help="File to write.")],
    alpha: Annotated[float, typer.Option(help="Order α; at the first sample if --alpha-end is given.")] = 0.3,
    alpha_end: Annotated[
        float | None, typer.Option(help="Order at the last sample. It varies linearly from --alpha.")
    ] = None,
    f: Annotated[float, typer.Option("--f", help="Parameter f in s^-α, 0 or below.")] = -1.5,
    q: Annotated[
        float, typer.Option("--q", help="Variance of ω, (deg/s)² s^-2α; 0 gives white noise.")
    ] = 0.15,
    r: Annotated[float, typer.Option("--r", help="Variance of the white noise v, (deg/s)².")] = 0.02,
    n: Annotated[int, typer.Option("--samples", "-n", help="Number of samples.")] = 6000,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Samples per second.")] = 100.0,
    axes: Annotated[int, typer.Option(help="Number of axes, 1 to 3, independent of each other.")] = 3,
    lsb: Annotated[
        float | None, typer.Option(metavar="N", help="Quantise with N LSB per deg/s (16.4 at ±2000 deg/s).")
    ] = None,
    full_scale: Annotated[
        float, typer.Option("--range", help="Full scale in deg/s when quantising.")
    ] = 2000.0,
    offset: Annotated[float, typer.Option(help="Offset in deg/s added to every axis.")] = 0.0,
    window: Annotated[int, typer.Option(help="Length L of the generator's memory in samples.")] = 3000,
    seed: Annotated[int, typer.Option(help="The same seed gives the same file.")] = 1,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json",
            help="Simulate the models of this file, which `fltea identify --export-model` wrote.",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace FILE if it exists.")] = False,
) -> None:
    """Simulate noise of known order α, constant or varying: y = x + v, D^α x = f x + ω.

    The file holds the measurement of each axis, the true state and the order. `fltea run -s replay:FILE`
    replays it.

    For example:

        fltea simulate noise.csv --alpha 0.5 --f -1 -n 60000

        fltea simulate varying.npz --alpha 0.2 --alpha-end 0.6 --lsb 16.4

        fltea simulate twin.npz --model sensor.json -n 60000
    """
    from fltea.identification.simulation_file import write_model_simulation, write_simulation
    from fltea.sources.synthetic import NoiseSettings

    _check_simulation(context, out, model, force=force)
    if lsb is not None and not lsb > 0:
        raise UsageError(f"simulate: --lsb has to be above 0, not {lsb:g}.")
    settings = NoiseSettings(alpha, f, q, r, offset, rate, lsb or 0.0, full_scale, seed, window, n)
    if model is not None:
        write_model_simulation(out, model, settings)
    else:
        write_simulation(out, settings, alpha if alpha_end is None else alpha_end, axes)


def _check_simulation(context: typer.Context, out: Path, model: Path | None, *, force: bool) -> None:
    """Raise UsageError if flags exclude each other, or if a file would be replaced that must not be.

    A model is never replaced, any other file only with --force.
    """
    sources = {name: context.get_parameter_source(name) for name in GIVEN_BY_MODEL}
    given = [name for name, source in sources.items() if source and source.name == "COMMANDLINE"]
    if model is not None and given:
        flags = ", ".join("--" + name.replace("_", "-") for name in given)
        raise UsageError(f"--model says what the noise is, so leave out {flags}.")
    check_outputs([("", out)], [(model, "the model")] if model else [])
    if not force and os.path.lexists(out):  # a broken symbolic link counts as existing, too
        raise UsageError(f"{out}: exists already; give another name, or --force to replace it.")


COMMANDS = (
    run,
    identify,
    record,
    info,
    export,
    recover,
    devices,
    doctor,
    flash,
    fleet,
    inspect,
    simulate,
    reproduce,
    bench,
)
for command in COMMANDS:
    app.command(epilog=ENDED_BY_CTRL_C if command in (run, record, fleet, inspect) else EXIT_CODES)(command)
