"""Count the steps that the tracker reports in noise without steps."""

from collections.abc import Sequence

from tools.validation.bias.noises import MODELLED, H, drawn, lanes
from tools.validation.live_way import AXES, LiveSensor
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped, number

SECTION = "false alarms"
HOURS, QUICK_HOURS = 24.0, 1.0
"""HOURS, QUICK_HOURS: hours of simulated data for each noise, in a full and in a quick run."""
AT_ONCE = 60_000
WEEK_H = 168.0


def tasks(options: Options) -> list[Task]:
    """Return one task for each noise."""
    hours = options.hours or (QUICK_HOURS if options.quick else HOURS)
    return [
        Task(name, count, (noise, hours), round(hours * 3600 / H))
        for noise in MODELLED
        if options.wanted(name := f"{SECTION}: {noise}")
    ]


def count(noise: str, hours: float) -> list[Row]:
    """Count the steps that are reported for one sensor whose axes have this noise."""
    axes = lanes(SECTION, noise, range(AXES))
    sensor, left = LiveSensor(AXES, H), round(hours * 3600 / H)
    while left:
        n = min(left, AT_ONCE)
        sensor.run(drawn(axes, n)[0])
        left -= n
    events = sensor.events()
    return [
        {
            "section": SECTION,
            "noise": noise,
            "axis_hours": AXES * hours,
            "events": None if events is None else len(events),
            "restarts": sensor.restarts,
        }
    ]


def tables(rows: Sequence[Row]) -> list[Table]:
    """Return a table of how many steps were reported, all of them wrongly, in total and per week and axis."""
    cells = []
    for noise, (row,) in grouped(rows, lambda row: row["noise"]).items():
        hours, told = row["axis_hours"], row["events"]
        a_week = None if told is None else told / hours * WEEK_H
        cells.append(
            (str(noise), f"{hours:g}", number(told, "d"), number(a_week, ".2g"), str(row["restarts"]))
        )
    headings = ("noise", "hours of an axis", "steps told", "a week and axis", "tracker began again")
    return [Table("Steps that are reported although there is none", headings, cells)]
