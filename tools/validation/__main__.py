"""`make validate`: what verdicts, fits and filters are worth, on noises whose truth is known."""

import sys

import typer
from fltea.cli.output import say
from fltea.records.errors import FlteaError

from tools.validation.evaluate_command import evaluate
from tools.validation.gallery_command import gallery

app = typer.Typer(help=__doc__, no_args_is_help=True, pretty_exceptions_enable=False)
app.command()(gallery)
app.command()(evaluate)


def main() -> None:
    """Run the part that is named; an expected failure is one line on stderr and an exit code."""
    try:
        app(prog_name="python -m tools.validation")
    except FlteaError as error:
        say(f"validation: error: {error}")
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
