"""The command `fltea flash`."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from fltea.cli.output import print_lines, say
from fltea.records.errors import UsageError
from fltea.records.visible import visible

if TYPE_CHECKING:
    from fltea.machine.flash import Plan


def flash(
    port: Annotated[
        str | None, typer.Option(metavar="PORT", help="Programming port; default: the only Due plugged in.")
    ] = None,
    image: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Image for bossac; default: the one in the clone."),
    ] = None,
    method: Annotated[
        Literal["auto", "arduino-cli", "platformio", "bossac"],
        typer.Option(
            help="`arduino-cli` and `platformio` build and upload the Arduino port; `bossac` writes the "
            "bare-metal image. `auto`: the first of them that is installed."
        ),
    ] = "auto",
    erase_unknown_board: Annotated[
        bool,
        typer.Option(
            "--erase-unknown-board",
            help="Go on at a --port whose USB id does not name a Due's programming port. Whatever board is "
            "there is erased.",
        ),
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the commands and do nothing.")] = False,
) -> None:
    """Write the firmware to an Arduino Due, and check that it runs.

    The board's program is erased, so only a port whose USB id names the programming port of a Due is opened.
    For the wiring and the two builds of the firmware, see firmware/README.md.

    For example:

        fltea flash

        fltea flash --port /dev/ttyACM0 --method bossac --yes
    """
    from fltea.machine import flash as flashing

    board_port = flashing.find_port(port, erase_unknown=erase_unknown_board)
    plan = flashing.make_plan(method, board_port, image, flashing.clone_root())
    if plan.warning:
        say(f"fltea: warning: {plan.warning}")
    if dry_run:
        print_lines("\n".join(plan.lines()))
        return
    if not yes:
        _ask(plan, "whatever board is" if erase_unknown_board else "the Due")
    flashing.carry_out(plan)
    hello = flashing.wait_for_hello(plan.port, plan.build_id)
    checked = "" if plan.build_id else " (no file beside the image names its build)"
    print_lines(f"{plan.port}: runs '{visible(hello.firmware_version)}'{checked}. Next: fltea run")


def _ask(plan: "Plan", what: str) -> None:
    if not sys.stdin.isatty():
        raise UsageError("flashing erases what is on the board; give --yes if that is meant.")
    typer.confirm(f"Erase {what} at {plan.port} and write fltea's firmware with {plan.method}?", abort=True)
