"""The commands of `fltea` as data: what their help, man pages and the site's reference are made of."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import typer.main
from fltea.cli.app import app

EXAMPLES = "For example:"
METAVARS = {"<str>": "WORD", "<int>": "N", "<float>": "NUMBER"}
"""What the command line calls a value that has no name of its own, and what a page does."""


@dataclass(frozen=True)
class Flag:
    """An option or an argument. names: `--source`, `-s`; of an argument its metavar. value: what follows."""

    names: tuple[str, ...]
    value: str | None
    text: str
    default: str | None
    argument: bool = False


@dataclass(frozen=True)
class Command:
    """A command. name: `fltea run`, or `fltea` for the program itself. summary: one sentence."""

    name: str
    summary: str
    paragraphs: tuple[str, ...]
    examples: tuple[str, ...]
    flags: tuple[Flag, ...]
    exits: str
    commands: tuple["Command", ...] = field(default=())

    @property
    def options(self) -> tuple[Flag, ...]:
        """The flags that begin with a dash."""
        return tuple(flag for flag in self.flags if not flag.argument)

    @property
    def arguments(self) -> tuple[Flag, ...]:
        """What stands after the options."""
        return tuple(flag for flag in self.flags if flag.argument)


def command_tree() -> Command:
    """Return the program with all its commands."""
    group: Any = typer.main.get_command(app)
    return _command("fltea", group, tuple(_below(group)))


def _below(group: Any) -> Iterator[Command]:
    for name, command in group.commands.items():
        yield _command(f"fltea {name}", command, ())


def _command(name: str, command: Any, below: tuple[Command, ...]) -> Command:
    context = command.make_context(name, [], resilient_parsing=True)
    text, _, examples = command.help.partition(EXAMPLES)
    paragraphs = [_joined(part) for part in re.split(r"\n\s*\n", text.strip())]
    shown = [parameter for parameter in command.get_params(context) if not parameter.hidden]
    return Command(
        name=name,
        summary=paragraphs[0],
        paragraphs=tuple(paragraphs[1:]),
        examples=tuple(line.strip() for line in examples.splitlines() if line.strip()),
        flags=tuple(_flag(parameter, context) for parameter in shown),
        exits=_joined(command.epilog or ""),
        commands=below,
    )


def _flag(parameter: Any, context: Any) -> Flag:
    if parameter.param_type_name == "argument":
        name = parameter.make_metavar(context).strip("[]").removesuffix("...")
        return Flag((name,), None, _joined(parameter.help or ""), None, argument=True)
    names = (*sorted(parameter.opts, key=len, reverse=True), *parameter.secondary_opts)
    metavar = None if parameter.is_flag else parameter.make_metavar(context)
    value = metavar and METAVARS.get(metavar, metavar)
    default = parameter.default
    given = None if default is None or callable(default) or isinstance(default, bool) else _shown(default)
    return Flag(names, value, _joined(parameter.help or ""), given)


def _shown(default: Any) -> str | None:
    if isinstance(default, list | tuple):
        return ", ".join(str(one) for one in default) or None
    if isinstance(default, Path) and default.is_absolute():
        return None  # of the machine that writes the page
    return str(getattr(default, "value", default))


def _joined(text: str) -> str:
    return " ".join(text.split())
