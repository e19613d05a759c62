"""Writes the site's table of outputs from the outputs' declarations."""

from fltea.settings.config import SETTINGS
from fltea.settings.outputs import OUTPUTS, Output


def switch(output: Output) -> str:
    """Return the command-line option that switches an output on."""
    setting = SETTINGS[output.on].setting
    return " ".join([setting.flags[0], *(output.when or (setting.metavar,))])


def outputs() -> str:
    """Return a row for each output.

    A row has the output's name in `stats.outputs`, what the output writes, and how it is switched on.
    """
    text = [
        "| output | gives | switched on by | package's extra | records of [many devices](ingest.md) |",
        "|---|---|---|---|---|",
    ]
    rows = {(output.name, output.when): output for output in reversed(OUTPUTS)}
    for output in reversed(rows.values()):
        anchor = output.section.lower().replace(" ", "-")
        cells = (
            f"[`{output.name}`](#{anchor})",
            output.what,
            f"`{switch(output)}`",
            f"`{output.extra}`" if output.extra else "none",
            "yes" if output.of_many else "no",
        )
        text.append(f"| {' | '.join(cells)} |")
    return "\n".join(text)
