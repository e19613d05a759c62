"""Tests of groups of options: a function gets them as one object, and on the command line they are ordinary
options.
"""

from dataclasses import dataclass
from typing import Annotated, Any

import typer
from fltea.cli.option_groups import flags_in_use, takes_groups
from typer.testing import CliRunner


@dataclass(frozen=True)
class Colours:
    red: Annotated[str | None, typer.Option(help="Red.")] = None
    dark_blue: Annotated[bool, typer.Option("--dark-blue", help="Blue.")] = False
    ink: Annotated[int, typer.Option("--drops", "-d", help="Drops.")] = 3


def called(*words: str) -> tuple[Any, ...]:
    given: list[Any] = []
    app = typer.Typer()

    @app.command()
    @takes_groups
    def paint(
        what: Annotated[str, typer.Argument()],
        colours: Colours,
        twice: Annotated[bool, typer.Option("--twice")] = False,
    ) -> None:
        given.extend((what, colours, twice))

    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    return tuple(given) or (result.output,)


def test_the_fields_of_a_group_are_options_in_its_place() -> None:
    assert called("wall") == ("wall", Colours(), False)
    assert called("--twice", "wall", "--red", "ochre", "-d", "5") == ("wall", Colours("ochre", ink=5), True)
    (text,) = called("--help")
    places = [text.index(flag) for flag in ("--red", "--dark-blue", "--drops", "--twice")]
    assert places == sorted(places)


def test_flags_in_use_are_those_of_the_declaration() -> None:
    colours = Colours("ochre", dark_blue=True)
    assert flags_in_use(colours, "dark_blue", "ink", "red") == ["--dark-blue", "--drops", "--red"]
    assert flags_in_use(Colours(), "dark_blue", "red") == []
