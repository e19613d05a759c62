"""`make man`: man pages and shell completion of every command, from the command line's own definitions.

Writes fltea.1, fltea-run.1 and so on to build/man, and the completions of bash, zsh and fish to
build/completions.
"""

import argparse
import re
from pathlib import Path
from typing import Any, NamedTuple

import typer.main
from fltea.cli.app import app
from fltea.records.version import __version__
from typer._completion_shared import get_completion_script

from tools.generated import TEMPLATES, rendered

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = "For example:"
METAVARS = {"<str>": "WORD", "<int>": "N", "<float>": "NUMBER"}
"""Typer prints a placeholder for a value that has no name. For each such placeholder: the word that man pages
print instead.
"""
COMPLETIONS = {"bash": "bash/fltea", "zsh": "zsh/_fltea", "fish": "fish/fltea.fish"}
"""For each shell: name of its file below the folder of completions, as the shell expects it."""

DOCUMENTS = "/usr/share/doc/fltea"
"""Folder in which the Debian package has the files of `host/docs`. Man pages refer to it, since a reader may
have no clone.
"""


def roff(text: str) -> str:
    """Return text escaped for a man page, so that no line is taken for a roff request.

    Words between backticks become bold.
    """
    text = text.replace("host/docs/", f"{DOCUMENTS}/").replace("\\", r"\e").replace("-", r"\-")
    text = re.sub(r"`([^`]*)`", r"\\fB\1\\fP", text)
    return "\n".join(r"\&" + line if line[:1] in (".", "'") else line for line in text.split("\n"))


TEMPLATES.filters |= {"roff": roff, "words": lambda text: roff(" ".join(text.split()))}


class Entry(NamedTuple):
    """An argument or option. `heading`: its names in bold and its value in italics."""

    name: str
    heading: str
    help: str
    default: str


def _entry(parameter: Any, context: Any) -> Entry:
    value = parameter.make_metavar(context)
    if parameter.param_type_name == "argument":
        name = value.strip("[]").removesuffix("...")
        return Entry(name, rf"\fB{roff(name)}\fP", parameter.help or "", "")
    names = (*sorted(parameter.opts, key=len, reverse=True), *parameter.secondary_opts)
    heading = ", ".join(rf"\fB{roff(name)}\fP" for name in names)
    if not parameter.is_flag:
        heading += rf" \fI{roff(METAVARS.get(value, value))}\fP"
    return Entry(names[0], heading, parameter.help or "", _default(parameter))


def _default(parameter: Any) -> str:
    """Return an option's default as text.

    The text is empty if the default is a path on the machine that writes the page.
    """
    default = getattr(parameter.default, "value", parameter.default)
    of_machine = isinstance(default, Path) and default.is_absolute()
    if default is None or callable(default) or isinstance(default, bool) or of_machine:
        return ""
    return ", ".join(map(str, default)) if isinstance(default, list | tuple) else str(default)


def page(name: str, command: Any) -> str:
    """Return the man page of one command, such as `fltea run`, or of the program itself."""
    context = command.make_context(name, [], resilient_parsing=True)
    shown = [parameter for parameter in command.get_params(context) if not parameter.hidden]
    arguments = [_entry(one, context) for one in shown if one.param_type_name == "argument"]
    options = [_entry(one, context) for one in shown if one.param_type_name != "argument"]
    text, _, examples = command.help.partition(EXAMPLES)
    summary, _, text = text.strip().partition("\n\n")
    return rendered(
        "man_page.1",
        name=name,
        dashed=name.replace(" ", "-"),
        version=__version__,
        summary=summary.strip().rstrip("."),
        paragraphs=[one for one in re.split(r"\n\s*\n", text.strip()) if one],
        below=[(word, one.help.split("\n\n")[0]) for word, one in getattr(command, "commands", {}).items()],
        arguments=arguments,
        options=options,
        examples=[one.strip() for one in examples.splitlines() if one.strip()],
        exit_codes=(command.epilog or "").strip().removeprefix("Exit codes: "),
        documents=DOCUMENTS,
    )


def pages() -> dict[str, str]:
    """Return the file name and text of every man page."""
    program: Any = typer.main.get_command(app)
    below = {f"fltea-{word}.1": page(f"fltea {word}", one) for word, one in program.commands.items()}
    return {"fltea.1": page("fltea", program), **below}


def completions() -> dict[str, str]:
    """Return the file name and script of every shell, as `fltea --show-completion` prints it."""
    return {
        file: get_completion_script(prog_name="fltea", complete_var="_FLTEA_COMPLETE", shell=shell) + "\n"
        for shell, file in COMPLETIONS.items()
    }


def main() -> None:
    """Write all files below the chosen folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build", help="folder; default: build")
    out = parser.parse_args().out
    for folder, files in (("man", pages()), ("completions", completions())):
        for name, text in files.items():
            file = out / folder / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
        print(f"wrote {len(files)} files in {out / folder}")


if __name__ == "__main__":
    main()
