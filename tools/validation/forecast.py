"""Measures how good forecasts are, and how good the tests of forecasts are.

The first half of each series predicts the second half.

The series are ten minutes at 100 Hz of the noises of `states`. Each half is processed as by `fltea identify
--forecast`.
"""

import zlib
from typing import Any

import numpy as np
from fltea.identification.axis import IdentifyOptions, analyse
from fltea.identification.forecast_judge import fitted_system, judged

from tools.validation.runner import Options, Row, Task
from tools.validation.states import NOISES, H, state, white
from tools.validation.tables import Table, grouped

SEEDS, QUICK_SEEDS = 60, 6
"""Number of series of each noise in a full and in a quick run."""
N = 60_000
OFFSET = 3.0


def tasks(options: Options) -> list[Task]:
    """Return a task for each noise."""
    return [Task(name, judge, (name, options.seeds), N) for name in NOISES if options.wanted(name)]


def judge(name: str, series: int) -> list[Row]:
    """Judge the forecasts for series of one noise.

    Returns rows with the predicted and the observed mean square of the heading error, for each series and
    time ahead.
    """
    rng = np.random.default_rng((20261125, zlib.crc32(name.encode())))
    parts = NOISES[name]
    rows: list[Row] = []
    for number in range(series):
        y = OFFSET + state(parts, rng, N) + white(parts, rng, N)
        half = y[: N // 2]
        found = analyse(half, H, IdentifyOptions(shuffles=0)).figures.model.parts(H)
        for one in judged(fitted_system(found, half, H), y, N // 2, H).heading:
            rows.append(
                {"noise": name, "series": number, **{k: getattr(one, k) for k in one.__struct_fields__}}
            )
    return rows


def tables(rows: list[Row]) -> list[Table | str]:
    """Return a table of how often headings are inside the 95 % band, for each noise and time ahead.

    The table also says for how many series the test of the forecasts rejects the model.
    """
    times = sorted({row["t_s"] for row in rows})
    cells: list[Any] = []
    for name, those in grouped(rows, lambda row: row["noise"]).items():
        shares = []
        for _, at in sorted(grouped(those, lambda row: row["t_s"]).items()):
            pieces = sum(row["pieces"] for row in at)
            shares.append(f"{100 * sum(row['within'] * row['pieces'] for row in at) / pieces:.1f} %")
        series = grouped(those, lambda row: row["series"]).values()
        fails = sum(any(row["fails"] for row in one) for one in series)
        cells.append((str(name), *shares, f"{fails} of {len(series)}"))
    columns = ("noise", *(f"{t:g} s" for t in times), "judge fails")
    return [Table("Pieces of the second half inside of the band of 95 %", columns, cells)]
