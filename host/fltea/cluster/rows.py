"""Rows of the table of results.

A recording has one row for each axis, or a single row with the reason for its failure.
"""

from collections.abc import Iterable
from typing import Any

import msgspec

from fltea.cluster.listing import File
from fltea.identification.axis_report import AxisReport, Failure, FileReport
from fltea.identification.data_checks import DataCheck, of_axis
from fltea.identification.load import Loaded

VALUES = ("alpha", "f", "F", "s2", "R")
COEFFICIENTS = ("N", "B", "K")
VALUE_COLUMNS = [name + end for name in (*VALUES, *COEFFICIENTS) for end in ("", "_low", "_high")]


# Why more than 12 attributes: each is one column of the table of verdicts.
class Row(msgspec.Struct, kw_only=True, omit_defaults=True):
    """A row for an axis. A file that failed has one row, with `error` and without `axis`.

    `size`, `stamp`: size [bytes] and change stamp of the file when it was listed. `settings`: digest of all
    settings. `again`: whether the next run tries the file again, since the failure is not the file's fault.
    `parts`: number of pieces of the file from which the figures were computed; 1 if it was read whole. Values
    are None where they are undefined. Columns named *_low and *_high hold the ends of 95 % intervals. α has
    no unit, f is in s^-α; N, B and K are in `unit`/√Hz, `unit`, and `unit`/√s. `longest_s`: longest duration
    without a gap [s]; processes slower than a tenth of it are not detected.
    """

    file: str
    size: int
    stamp: str
    settings: str
    parts: int = 1
    seconds: float | None = None
    """Time that workers spent on the file [s]."""
    error: str | None = None
    again: bool = False
    device_id: str | None = None
    sensor: str | None = None
    axis: str | None = None
    unit: str | None = None
    rate_hz: float | None = None
    samples: int | None = None
    lost: int | None = None
    duration_s: float | None = None
    longest_s: float | None = None
    kind: str | None = None
    text: str | None = None
    p_white: float | None = None
    """p-value of the test whether the noise is only white. The test uses the spectrum without its peaks."""
    mean: float | None = None
    std: float | None = None
    lsb: float | None = None
    values: dict[str, float | None] = {}
    """Figures of the fit and of the Allan deviation, and the ends of their intervals, by the names of their
    columns (`VALUE_COLUMNS`).
    """
    fltea_alpha: float | None = None
    """Last α of the FLTEA filter; None if the file was read in pieces, since the filter needs all samples."""
    fltea_f: float | None = None
    fltea_describes_noise: bool | None = None
    data_checks: list[str] | None = None


_row = msgspec.json.Decoder(Row)


class Key(msgspec.Struct, frozen=True):
    """Identifies a file as it was listed, together with the settings of the run."""

    file: File
    settings: str

    def row(self, **values: Any) -> Row:
        """Return a row for the file. `values`: the row's further fields."""
        file = self.file
        return Row(file=file.url, size=file.size, stamp=file.stamp, settings=self.settings, **values)

    def has(self, row: object) -> bool:
        """Return whether `row` is a row of this file with valid types and columns."""
        if not isinstance(row, Row) or not row.values.keys() <= set(VALUE_COLUMNS):
            return False
        try:
            _row.decode(msgspec.json.encode(row))
        except (msgspec.MsgspecError, TypeError):
            return False
        file = self.file
        ours = (file.url, file.size, file.stamp, self.settings)
        return (row.file, row.size, row.stamp, row.settings) == ours


def failed(key: Key, reason: str, *, again: bool, parts: int = 1) -> list[Row]:
    """Return the row for a file whose noise could not be identified."""
    return [key.row(error=reason, again=again, parts=parts)]


def rows_of(key: Key, report: FileReport, seconds: float) -> list[Row]:
    """Return a row for each axis of a recording that was read whole."""
    if report.recording is None:
        return failed(key, str(report.failure), again=False)
    return [
        _axis(key, report.recording, name, axis, round(seconds, 3)) for name, axis in report.axes.items()
    ] or failed(key, "it has no axes", again=False)


def _axis(key: Key, recording: Loaded, name: str, axis: AxisReport | Failure, seconds: float) -> Row:
    about = of_recording(recording)
    if isinstance(axis, Failure):
        return key.row(axis=name, error=axis.error, seconds=seconds, **about)
    r = axis.result
    allan = {} if axis.allan is None else with_ends(axis.allan, COEFFICIENTS)
    return key.row(
        axis=name,
        seconds=seconds,
        unit=axis.unit,
        rate_hz=r.rate_hz,
        samples=r.samples,
        duration_s=r.duration_s,
        longest_s=r.longest_stretch / r.rate_hz,
        kind=r.verdict.kind,
        text=r.verdict.text,
        p_white=r.null.p_clean,
        mean=r.mean,
        std=r.std,
        lsb=axis.lsb,
        fltea_alpha=r.fltea and r.fltea.alpha,
        fltea_f=r.fltea and r.fltea.f,
        fltea_describes_noise=r.fltea and r.fltea.describes_noise,
        data_checks=data_check_kinds((*of_axis(recording.data_checks, name), *axis.data_checks)),
        values=with_ends(r.order, VALUES) | allan,
        **about,
    )


def of_recording(recording: Loaded) -> dict[str, Any]:
    """Return what the device states about itself, and the number of lost samples."""
    hello = recording.hello
    return {"device_id": hello.device_id, "sensor": hello.sensor, "lost": recording.counts.lost}


def data_check_kinds(data_checks: Iterable[DataCheck]) -> list[str]:
    """Return the kinds of the data checks without repetition."""
    return sorted({data_check.kind for data_check in data_checks})


def with_ends(of: Any, names: Iterable[str]) -> dict[str, float | None]:
    """Return the columns of figures such as N: for each the value `N`, and its interval `N_low`, `N_high`.

    `of`: object with the figures as attributes; `names`: those that are wanted.
    """
    found: dict[str, float | None] = {}
    for name in names:
        one = getattr(of, name)
        found |= {name: one.value, f"{name}_low": one.low, f"{name}_high": one.high}
    return found
