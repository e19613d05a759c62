"""Write the Allan deviations of a recording as a table, for use in other programs."""

import csv
import io
from collections.abc import Iterator, Mapping
from pathlib import Path

from fltea.identification.model_file import write_text
from fltea.spectrum.allan_curve import Allan

COLUMNS = {
    "axis": "the axis",
    "unit": "the unit of the five deviations, `deg/s` or `m/s^2`",
    "tau_s": "averaging time in s",
    "adev": "overlapping Allan deviation",
    "adev_low": "lower end of its 95 % interval",
    "adev_high": "upper end of its 95 % interval",
    "edf": "degrees of freedom of its square (Greenhall and Riley, 2003)",
    "differences": "how many differences of neighbouring means were averaged",
    "adev_model": "Allan deviation of the model that stands for the noise",
}
"""Name and meaning of each column of the table."""

Row = tuple[str, str, float, float, float, float, float, int, float]


def rows(curves: Mapping[str, tuple[str, Allan]]) -> Iterator[Row]:
    """Yield a row for each averaging time of each axis.

    `curves`: unit and Allan deviation of each axis, by the axis's name.
    """
    for axis, (unit, a) in curves.items():
        counts = map(int, a.differences)
        figures = zip(a.tau_s, a.deviation, a.low, a.high, a.degrees_of_freedom, counts, a.model, strict=True)
        for one in figures:
            yield axis, unit.replace("²", "^2"), *one


def write_allan(path: Path, curves: Mapping[str, tuple[str, Allan]]) -> None:
    """Write Allan deviations as CSV; it is written completely or not at all.

    Raises:
        FlteaError: the file cannot be written.
        ValueError: `curves` is empty.
    """
    if not curves:
        raise ValueError("there is no Allan deviation: the record is too short, or all its axes are constant")
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    table.writerows(rows(curves))
    write_text(path, text.getvalue())
