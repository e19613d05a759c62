"""Read a recording, of any format that `fltea identify` reads, as arrays."""

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from fltea.api._check import in_python, period_s, python_words
from fltea.api._html import page
from fltea.api._tables import columns, parquet
from fltea.api.identified import Report
from fltea.api.series import agreed, examine, of_series, watched_looks
from fltea.identification.axis import IdentifyOptions
from fltea.identification.counts import Counts
from fltea.identification.data_checks import DataCheck, of_axis
from fltea.identification.forecast import Asked
from fltea.identification.load import (
    Loaded,
    Request,
    Unreadable,
    load,
    recordings,
)
from fltea.recording.reading import Answer
from fltea.records.arrays import Array
from fltea.records.errors import UsageError
from fltea.records.sensor_kind import SENSOR_KINDS
from fltea.settings.how import How, TimeUnit

if TYPE_CHECKING:
    import pandas as pd


IN_NAMES = {kind.text_unit: kind.column_unit for kind in SENSOR_KINDS}
"""How each unit of the samples is written in the names of a table's columns."""


class Recording(Mapping[str, Array]):
    """The samples of each axis by name, as arrays (n,) of float64: `recording["gyro_x"]`."""

    def __init__(self, name: str, loaded: Loaded) -> None:
        self.name = name
        """Name of the file or session that was opened."""
        self.counts: Counts = loaded.counts
        """Counts of all samples, used samples and missing samples."""
        self.data_checks: tuple[DataCheck, ...] = loaded.data_checks
        """Findings on the recording as a whole; empty if there are none."""
        self.reading: tuple[Answer, ...] = tuple(
            replace(one, why=in_python(one.why)) for one in loaded.reading
        )
        """How the file was read: answers on unit, rate and the like, each with its evidence."""
        self._loaded = loaded

    def __getitem__(self, axis: str) -> Array:
        if axis not in self._loaded.axes:
            raise KeyError(
                f"{axis}: no such axis; the axes that were read from {self.name} are {', '.join(self)}"
            )
        return self._loaded.axes[axis].y

    def __iter__(self) -> Iterator[str]:
        return iter(self._loaded.axes)

    def __len__(self) -> int:
        return len(self._loaded.axes)

    def __repr__(self) -> str:
        c = self.counts
        samples = f"{c.used} of {c.samples} samples, {self.rate_hz:g} Hz"
        return f"Recording({self.name!r}, {', '.join(self)}, {samples})"

    @property
    def rate_hz(self) -> float:
        """Sampling rate in Hz."""
        return float(self._loaded.hello.rate_hz)

    @property
    def time_s(self) -> Array:
        """Time of each sample since the first one [s], (n,). The time of lost samples is included.

        For a gap whose number of lost samples is not known, as at a restart, no time is added.
        """
        gaps = next(iter(self._loaded.axes.values())).gaps
        number = np.arange(self.counts.used)
        number[1:] += np.cumsum(np.bincount(gaps.at, gaps.missing, len(number))).astype(np.int64)[1:]
        return np.asarray(number / self.rate_hz)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each axis, by its name."""
        return {name: series.unit for name, series in self._loaded.axes.items()}

    def identify(
        self,
        *,
        from_hz: float = 0.0,
        notch_hz: Sequence[tuple[float, float]] = (),
        forecast: Asked = False,
    ) -> Report:
        """Identify the noise of each axis; arguments as for `fltea.identify`.

        Raises:
            ValueError: an axis is constant or too short, or a band is impossible.
        """
        options = IdentifyOptions(from_hz=from_hz, notch_hz=tuple((low, high) for low, high in notch_hz))
        h = self._loaded.h
        examined = {}
        for name, series in self._loaded.axes.items():
            with self._of_axis(name):
                examined[name] = examine(series, h, options, of_axis(self.data_checks, name))
        with python_words():
            watched = watched_looks(self._loaded.axes, self._loaded.accel, examined, h, options)
        tracked = agreed({name: one.examined for name, one in watched.items()}, h)
        found = {}
        for name, one in watched.items():
            with self._of_axis(name):
                found[name] = of_series(name, one, options, tracked.get(name), forecast=forecast)
        return Report(found)

    @contextlib.contextmanager
    def _of_axis(self, name: str) -> Iterator[None]:
        """Put the names of the recording and the axis before the texts of errors."""
        try:
            with python_words():
                yield
        except ValueError as error:
            raise ValueError(f"{self.name}, {name}: {error}") from error

    def to_pandas(self) -> "pd.DataFrame":
        """Return a table with one column for each axis, and `time_s` as its index.

        Raises:
            UsageError: pandas is not installed.
        """
        return columns(self, self.time_s)

    def to_parquet(self, path: str | os.PathLike[str]) -> None:
        """Write `time_s` and the axes, as `gyro_x_dps` or `accel_x_ms2`, to a Parquet file.

        The file is written completely or not at all.

        Raises:
            UsageError: pyarrow is not installed.
            FlteaError: the file cannot be written.
        """
        found = {f"{name}_{IN_NAMES[self.units[name]]}": y for name, y in self.items()}
        parquet(Path(path), {"time_s": self.time_s, **found})

    def _repr_html_(self) -> str:
        c = self.counts
        rows = "".join(
            f"<tr><th>{escape(name)}</th><td>{y.mean():.4g}</td><td>{y.std(ddof=1):.4g}</td>"
            f"<td>{escape(self.units[name])}</td></tr>"
            for name, y in self.items()
        )
        problems = "".join(
            f"<br>{escape(f'{data_check.text} {data_check.remedy}')}" for data_check in self.data_checks
        )
        reading = "".join(
            f"<tr><th>{one.question}</th><td>{escape(str(one))}</td></tr>" for one in self.reading
        )
        return page(
            f"<p><strong>{escape(self.name)}</strong> {c.used:,} of {c.samples:,} samples "
            f"at {self.rate_hz:g} Hz, {c.lost:,} lost in {c.gaps:,} gaps{problems}</p>"
            f"<table><tr><th>axis</th><th>mean</th><th>σ</th><th>unit</th></tr>{rows}</table>"
            + (f"<table>{reading}</table>" if reading else "")
        )


def open(
    path: str | os.PathLike[str],
    *,
    axes: Sequence[str] | None = None,
    columns: Sequence[str | int] | None = None,
    units: str | None = None,
    rate_hz: float | None = None,
    time_column: str | int | None = None,
    time_unit: TimeUnit | None = None,
    topic: str | None = None,
    accel_units: str | None = None,
    overrule: bool = False,
) -> Recording:
    """Read a recording of any format that `fltea identify` reads.

    Pass as arguments what the file does not state.

    Args:
        path: a file, a folder with parts of one session, or the session's name.
        axes: names of the axes; None: all of the gyroscope's, and the accelerometer's if there is one.
        columns: columns of the axes, by name or position from 1.
        units: unit of the rates: deg/s, mdps, rad/s … or lsb:N (N counts are 1 deg/s).
        rate_hz: sampling rate in Hz, if the file has no times.
        time_column: column of the times, by name or position from 1.
        time_unit: unit of the times: s, ms, us or ns.
        topic: the sensor to read if a file has several: a topic of a bag or of a PX4 log (sensor_gyro:1), the
            value in the column that tells sensors apart (1), or 1/2 for the first of two sensors with
            alternating rows.
        accel_units: unit of the accelerometer: m/s^2, g, mg … or lsb:N (N counts are 1 g).
        overrule: whether these arguments are used even if the file itself states another unit or rate.

    Raises:
        UsageError: the file cannot be read, holds several recordings, or lacks these axes; the text says why.
        ValueError: the rate is impossible.
    """
    if rate_hz is not None:
        period_s(rate_hz)
    how = How(
        columns=None if columns is None else list(map(str, columns)),
        units=units,
        rate_hz=rate_hz,
        time_column=None if time_column is None else str(time_column),
        time_unit=time_unit,
        topic=topic,
        accel_units=accel_units,
        overrule=overrule,
    )
    with python_words():
        found = recordings([Path(path)])
        if len(found) != 1:
            raise UsageError(f"{path}: holds {len(found)} recordings; open one by its file or session.")
        if isinstance(found[0], Unreadable):
            raise found[0].error
        request = Request(found[0], None if axes is None else tuple(axes), how, accel=True)
        return Recording(request.name, load(request))
