"""Settings by which users state the columns, units or rate of a recording that does not state them itself."""

from collections.abc import Collection
from typing import Annotated, Literal

from fltea.settings.setting import Setting, Table, declared

TimeUnit = Literal["s", "ms", "us", "ns"]


class How(Table, frozen=True, kw_only=True):
    """What the user states about a recording. Everything that is unset here, the file itself must state."""

    columns: Annotated[
        list[str] | None,
        Setting(
            "Text and tables: the columns of the axes, by name or position from 1.",
            flags=("--columns",),
            metavar="A,B,C",
            example=["gx", "gy", "gz"],
        ),
    ] = None
    units: Annotated[
        str | None,
        Setting(
            "Unit of the rates: deg/s (dps, °/s), mdps, rad/s, mrad/s, deg/h, rpm, or lsb:N (N counts are 1 "
            "deg/s).",
            flags=("--units",),
            metavar="UNIT",
            example="dps",
        ),
    ] = None
    rate_hz: Annotated[
        float | None,
        Setting(
            "Text and tables: samples per second.",
            unit="Hz",
            above=0,
            flags=("--rate",),
            metavar="HZ",
            example=100.0,
        ),
    ] = None
    time_column: Annotated[
        str | None,
        Setting(
            "Text and tables: the column of times, by name or position.",
            flags=("--time-column",),
            metavar="NAME",
            example="t_ms",
        ),
    ] = None
    time_unit: Annotated[
        TimeUnit | None,
        Setting("Text and tables: unit of the times.", flags=("--time-unit",), example="ms"),
    ] = None
    topic: Annotated[
        str | None,
        Setting(
            "Which sensor to read, if a file has several: a topic of a bag or of a PX4 log "
            "(sensor_gyro:1), the value in the column that names the sensor (1), or 1/2 for the first of "
            "two sensors whose rows alternate.",
            flags=("--topic", "--sensor"),
            metavar="NAME",
            example="/imu",
        ),
    ] = None
    accel_units: Annotated[
        str | None,
        Setting(
            "Unit of the accelerometer: m/s^2, g, mg, mm/s^2, or lsb:N (N counts are 1 g).",
            flags=("--accel-units",),
            metavar="UNIT",
            example="g",
        ),
    ] = None
    overrule: Annotated[
        bool,
        Setting(
            "The file is wrong: use the unit and rate of the other options, even where the file itself "
            "states others.",
            flags=("--overrule",),
        ),
    ] = False

    def flags(self, but: Collection[str] = ()) -> list[str]:
        """Return the flags of all settings that the user has set, except the fields named in `but`."""
        return [
            field.setting.flags[0]
            for field in declared(self)
            if field.default != getattr(AS_IT_SAYS, field.name) and field.name not in but
        ]


AS_IT_SAYS = How()
