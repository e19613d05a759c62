"""Options that say how a recording is to be read; the same for every command."""

from typing import Annotated

import typer

from fltea.settings.how import TimeUnit

Columns = Annotated[
    str | None,
    typer.Option(
        "--columns", metavar="A,B,C", help="Text, tables: the columns of the axes, or positions from 1."
    ),
]
Units = Annotated[
    str | None, typer.Option("--units", help="Text, tables: deg/s, °/s, dps, mdps, rad/s, or lsb:N.")
]
Rate = Annotated[float | None, typer.Option("--rate", metavar="HZ", help="Text, tables: samples per second.")]
TimeColumn = Annotated[
    str | None, typer.Option("--time-column", metavar="NAME", help="Text, tables: the column of times.")
]
TimeUnitOption = Annotated[
    TimeUnit | None, typer.Option("--time-unit", help="Text, tables: what the times are counted in.")
]
Topic = Annotated[
    str | None, typer.Option("--topic", metavar="NAME", help="Bags: the Imu topic, where there are several.")
]
