"""`make man`: man pages and shell completion of every command, from the command line's own definitions.

Into build/man: fltea.1, and fltea-run.1 and its like. Into build/completions: what bash, zsh and fish read.
"""

import argparse
import re
from pathlib import Path
from typing import Any

import typer.main
from fltea.cli.app import app
from fltea.records.version import __version__
from typer._completion_shared import get_completion_script

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = "For example:"
METAVARS = {"<str>": "WORD", "<int>": "N", "<float>": "NUMBER"}
"""What the command line calls a value that has no name of its own, and what a page does."""
COMPLETIONS = {"bash": "bash/fltea", "zsh": "zsh/_fltea", "fish": "fish/fltea.fish"}
"""Shell to its file, by the name that the shell looks for in a folder of completions."""

DOCUMENTS = "/usr/share/doc/fltea"
"""Where the Debian package has what is in `host/docs`: whoever reads a man page may have no clone."""


def roff(text: str) -> str:
    """Return text as a man page's: nothing of it is a request, and `words` are bold."""
    text = text.replace("host/docs/", f"{DOCUMENTS}/").replace("\\", r"\e").replace("-", r"\-")
    text = re.sub(r"`([^`]*)`", r"\\fB\1\\fP", text)
    return "\n".join(r"\&" + line if line[:1] in (".", "'") else line for line in text.split("\n"))


def _words(text: str) -> str:
    return roff(" ".join(text.split()))


def _paragraphs(text: str) -> list[str]:
    return [part for one in re.split(r"\n\s*\n", text.strip()) if one for part in (".PP", _words(one))]


def _heading(parameter: Any, context: Any) -> str:
    if parameter.param_type_name == "argument":
        return rf"\fB{roff(_argument(parameter, context))}\fP"
    names = (*sorted(parameter.opts, key=len, reverse=True), *parameter.secondary_opts)
    shown = ", ".join(rf"\fB{roff(name)}\fP" for name in names)
    if parameter.is_flag:
        return shown
    value = parameter.make_metavar(context)
    return rf"{shown} \fI{roff(METAVARS.get(value, value))}\fP"


def _argument(parameter: Any, context: Any) -> str:
    name: str = parameter.make_metavar(context)
    return name.strip("[]").removesuffix("...")


def _default(parameter: Any) -> list[str]:
    """Return the line about an option's default, unless it is a path of the machine that writes the page."""
    default = getattr(parameter.default, "value", parameter.default)
    of_machine = isinstance(default, Path) and default.is_absolute()
    if (
        parameter.param_type_name == "argument"
        or callable(default)
        or isinstance(default, bool)
        or of_machine
    ):
        return []
    words = ", ".join(str(one) for one in default) if isinstance(default, list | tuple) else default
    return [roff(f"Default: {words}.")] if words not in (None, "") else []


def page(name: str, command: Any) -> str:
    """Return the man page of one command, `fltea run`, or of the program itself."""
    context = command.make_context(name, [], resilient_parsing=True)
    below = getattr(command, "commands", {})
    shown = [parameter for parameter in command.get_params(context) if not parameter.hidden]
    arguments = [one for one in shown if one.param_type_name == "argument"]
    options = [one for one in shown if one.param_type_name != "argument"]
    text, _, examples = command.help.partition(EXAMPLES)
    summary, _, text = text.strip().partition("\n\n")
    dashed = name.replace(" ", "-")
    lines = [
        f'.TH {dashed.upper()} 1 "" "fltea {__version__}" "User Commands"',
        ".SH NAME",
        _words(f"{dashed} - {summary.strip().rstrip('.')}"),
        ".SH SYNOPSIS",
        rf".B {roff(name)}",
        r"[\fIOPTIONS\fP]",
        *([r"\fICOMMAND\fP [\fIARGUMENTS\fP]"] if below else []),
        *(rf"\fI{roff(_argument(one, context))}\fP" for one in arguments),
        *([".SH DESCRIPTION", *_paragraphs(text)] if text.strip() else []),
    ]
    lines += [".SH COMMANDS"] if below else []
    for word, one in below.items():
        lines += [".TP", rf"\fB{roff(f'{dashed}-{word}')}\fP(1)", _words(one.help.split("\n\n")[0])]
    for title, some in (("ARGUMENTS", arguments), ("OPTIONS", options)):
        lines += [f".SH {title}"] if some else []
        for one in some:
            lines += [".TP", _heading(one, context), _words(one.help or ""), *_default(one)]
    lines += [".SH EXAMPLES"] if examples.strip() else []
    for example in filter(str.strip, examples.splitlines()):
        lines += [".PP", ".nf", roff(example.strip()), ".fi"]
    lines += [".SH EXIT STATUS", _words((command.epilog or "").strip().removeprefix("Exit codes: "))]
    lines += [
        ".SH SEE ALSO",
        "" if below else r"\fBfltea\fP(1),",
        roff(f"{DOCUMENTS}/guide/troubleshooting.md"),
    ]
    return "\n".join(lines) + "\n"


def pages() -> dict[str, str]:
    """Return the name of every man page's file with its text."""
    program: Any = typer.main.get_command(app)
    below = {f"fltea-{word}.1": page(f"fltea {word}", one) for word, one in program.commands.items()}
    return {"fltea.1": page("fltea", program), **below}


def completions() -> dict[str, str]:
    """Return the file of every shell with its script, as `fltea --show-completion` prints it."""
    return {
        file: get_completion_script(prog_name="fltea", complete_var="_FLTEA_COMPLETE", shell=shell) + "\n"
        for shell, file in COMPLETIONS.items()
    }


def main() -> None:
    """Write everything below the folder that is asked for."""
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
