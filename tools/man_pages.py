"""`make man`: man pages and shell completion of every command, from the command line's own definitions.

Into build/man: fltea.1, and fltea-run.1 and its like. Into build/completions: what bash, zsh and fish read.
"""

import argparse
import re
from pathlib import Path

from command_tree import Command, Flag, command_tree
from fltea.records.version import __version__
from typer._completion_shared import get_completion_script

ROOT = Path(__file__).resolve().parents[1]
COMPLETIONS = {"bash": "bash/fltea", "zsh": "zsh/_fltea", "fish": "fish/fltea.fish"}
"""Shell to its file, by the name that the shell looks for in a folder of completions."""


def roff(text: str) -> str:
    """Return text as a man page's: nothing of it is a request, and `words` are bold."""
    text = text.replace("\\", r"\e").replace("-", r"\-")
    text = re.sub(r"`([^`]*)`", r"\\fB\1\\fP", text)
    return "\n".join(r"\&" + line if line[:1] in (".", "'") else line for line in text.split("\n"))


def _heading(flag: Flag) -> str:
    names = ", ".join(rf"\fB{roff(name)}\fP" for name in flag.names)
    return names if flag.value is None else rf"{names} \fI{roff(flag.value)}\fP"


def _flags(title: str, flags: tuple[Flag, ...]) -> list[str]:
    lines = [f".SH {title}"] if flags else []
    for flag in flags:
        lines += [".TP", _heading(flag), roff(flag.text)]
        if flag.default is not None:
            lines.append(roff(f"Default: {flag.default}."))
    return lines


def page(command: Command) -> str:
    """Return the man page of one command."""
    dashed = command.name.replace(" ", "-")
    usage = [rf".B {roff(command.name)}", r"[\fIOPTIONS\fP]"]
    usage += [r"\fICOMMAND\fP [\fIARGUMENTS\fP]"] if command.commands else []
    usage += [rf"\fI{roff(flag.names[0])}\fP" for flag in command.arguments]
    lines = [
        f'.TH {dashed.upper()} 1 "" "fltea {__version__}" "User Commands"',
        ".SH NAME",
        roff(f"{dashed} - {command.summary.rstrip('.')}"),
        ".SH SYNOPSIS",
        *usage,
    ]
    if command.paragraphs:
        lines.append(".SH DESCRIPTION")
        for paragraph in command.paragraphs:
            lines += [".PP", roff(paragraph)]
    if command.commands:
        lines.append(".SH COMMANDS")
        for below in command.commands:
            lines += [".TP", rf"\fB{roff(below.name.replace(' ', '-'))}\fP(1)", roff(below.summary)]
    lines += _flags("ARGUMENTS", command.arguments)
    lines += _flags("OPTIONS", command.options)
    if command.examples:
        lines.append(".SH EXAMPLES")
        lines += [part for example in command.examples for part in (".PP", ".nf", roff(example), ".fi")]
    if command.exits:
        lines += [".SH EXIT STATUS", roff(command.exits.removeprefix("Exit codes: "))]
    if not command.commands:
        lines += [".SH SEE ALSO", r"\fBfltea\fP(1)"]
    return "\n".join(lines) + "\n"


def pages() -> dict[str, str]:
    """Return the name of every man page's file with its text."""
    program = command_tree()
    return {f"{one.name.replace(' ', '-')}.1": page(one) for one in (program, *program.commands)}


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
