"""Exports a recording as a table: CSV, or arrays in an .npz file, with units in the names.

Samples, and rates minus their biases, are computed again from the recorded raw bytes, which are always
complete. All else is taken from the JSON channels of the recording: it was computed during the recording,
with the settings of that run. For other settings, run `fltea run` on the recording.
"""

import csv
import os
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.archive.published import MOST_TEXT, OF_ALL, OF_TEXT, Table, What, published_table
from fltea.recording.files import AT_ONCE
from fltea.recording.kind import is_one_file
from fltea.recording.spool import Spool
from fltea.records.errors import UsageError
from fltea.records.events import Values
from fltea.records.sensor_kind import SENSOR_KINDS
from fltea.records.whole_file import check_outputs, text_of, whole_file
from fltea.settings.duration import Duration
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits
from fltea.sources.replay import ReplaySource, open_mcap
from fltea.stream.decode import Decoded, Decoder

if TYPE_CHECKING:
    pass

Array = NDArray[np.float64]


class Exported(NamedTuple):
    """Result of an export: number of rows, and reasons why files were not or not completely read."""

    rows: int
    unread: list[str]


def export(
    paths: Sequence[Path],
    out: Path,
    what: What,
    max_gap: Duration,
    *,
    force: bool = False,
    limits: Limits = DEFAULT_LIMITS,
    how: How = AS_IT_SAYS,
) -> Exported:
    """Write samples or estimates of one recording; the file is written completely or not at all.

    `force`: replace an existing file at `out`. `how`: the user's options for reading the recording.

    Raises:
        UsageError: there is no recording, it has no data of the requested kind, `out` exists already or ends
            neither in .csv nor in .npz, or the export needs more memory than the limits allow.
        FlteaError: the file cannot be written.
    """
    suffix = out.suffix.lower()
    if suffix not in (".csv", ".npz"):
        raise UsageError(f"--to {out}: give a name that ends in .csv or .npz.")
    if not force and os.path.lexists(out):  # a broken symbolic link counts as existing, too
        raise UsageError(f"--to {out}: exists already; give another name, or --force to replace it.")
    check_outputs([("--to", out)], [(path, "the recording") for path in paths])
    with whole_file(out) as file:
        # files of other programs hold no published records
        was_published = what not in ("samples", "corrected")
        source = None if was_published and is_one_file(paths[0]) else _source(paths, limits, how)
        if suffix == ".csv":
            table = (
                sample_table(decode(source, max_gap))
                if what == "samples"
                else published_table(paths, source, what, max_gap)
            )
            rows = _write_csv(file, table)
        else:
            with Spool() as spool:
                scales, rows = (
                    gather_samples(spool, decode(source, max_gap))
                    if what == "samples"
                    else ({}, gather_rows(spool, published_table(paths, source, what, max_gap)))
                )
                spool.write_npz(file, scales)
        if not rows:
            raise UsageError(f"{paths[0]}: holds no samples that can be used.")
    return Exported(rows, [] if source is None else source.unread)


def decode(source: Any, max_gap: Duration) -> Iterator[Decoded]:
    """Yield the blocks of samples of a recording of any format."""
    decoder = Decoder(lambda: int(source.unix_offset_ns), max_gap)
    for event in source.events():
        for found in decoder.feed(event):
            if isinstance(found, Decoded):
                yield found


def _source(paths: Sequence[Path], limits: Limits, how: How) -> Any:
    """Return the source that reads a recording of any format and yields its samples and messages (events)."""
    if len(paths) == 1 and is_one_file(paths[0]):
        return ReplaySource(paths[0], how=how, limits=limits)
    return open_mcap(paths, f"replay:{paths[0]}", limits)()


class DeviceTime:
    """Computes the time of each sample since the first sample [s] by the device's clock.

    The time across a restart of the device is taken from the host's clock.
    """

    def __init__(self) -> None:
        self._origin_us: int | None = None
        self._base_s = 0.0
        self._first_ns = 0
        self._last: tuple[int, int, float] = (0, 0, 0.0)

    def add(self, found: Decoded) -> Array:
        """Return the times of the next block of samples [s], (n,), strictly increasing."""
        block = found.block
        seq, device_us, time_s = self._last
        first_us = int(block.device_us[0])
        if self._origin_us is None:
            self._origin_us, self._first_ns = first_us, int(block.host_ns[0])
        elif found.new_epoch is not None and (int(block.seq[0]) <= seq or first_us <= device_us):
            host_s = (int(block.host_ns[0]) - self._first_ns) * 1e-9
            self._base_s = max(host_s, time_s + 1.0 / found.hello.rate_hz)
            self._origin_us = first_us
        times: Array = np.float64(self._base_s) + (block.device_us - self._origin_us) * np.float64(1e-6)
        self._last = int(block.seq[-1]), int(block.device_us[-1]), float(times[-1])
        return times


def sample_table(decoded: Iterable[Decoded]) -> Table:
    """Return a table with one row for each sample.

    Columns for quantities that the recording lacks stay empty.
    """
    columns = ["time_s", *(f"{axis}_{kind.column_unit}" for kind in SENSOR_KINDS for axis in kind.axes)]
    columns += ["temperature_c", "epoch", "seq", "device_us", "host_ns", "flags"]

    def rows() -> Iterator[list[Any]]:
        clock = DeviceTime()
        for found in decoded:
            times = np.round(clock.add(found), 6).tolist()
            for time_s, s in zip(times, found.block.samples(), strict=True):
                values: list[Any] = []
                for kind in SENSOR_KINDS:
                    known = getattr(s, kind.samples_field) or ()
                    values += [*known, *([None] * (len(kind.axes) - len(known)))]
                place = s.epoch, s.seq, s.device_us, s.host_ns, s.flags
                yield [time_s, *values, s.temperature_c, *place]

    return Table(columns, rows())


def gather_samples(spool: Spool, decoded: Iterable[Decoded]) -> tuple[dict[str, float], int]:
    """Write the arrays of an .npz file that the source `replay:` reads (host/docs/guide/sources.md).

    Return its scales (sampling rate, counts per deg/s, counts per g) and its number of rows.

    Raises:
        UsageError: rate or scale change within the recording; an .npz file has one value of each.
    """
    clock = DeviceTime()
    settings: tuple[float, float | None, float | None, int] | None = None
    first_ns = rows = 0
    warm = False
    for found in decoded:
        hello, block, raw = found.hello, found.block, found.raw
        of_now = hello.rate_hz, hello.gyro_lsb_per_dps, hello.accel_lsb_per_g, raw.gyro.shape[1]
        if settings is None:
            settings, first_ns = of_now, int(raw.host_ns[0])
        if of_now != settings:
            raise UsageError(
                "rate or scale change within this recording; export it as .csv, in physical units."
            )
        n = len(block)
        spool.append("time_s", np.round(clock.add(found), 6))
        spool.append("t_host_s", (raw.host_ns - first_ns) * 1e-9)
        if hello.gyro_lsb_per_dps is None:
            spool.append("gyro_dps", raw.gyro)
        else:
            spool.append("gyro_raw", _counts(raw.gyro))
        if raw.accel is not None and hello.accel_lsb_per_g is None:
            spool.append("accel_ms2", raw.accel)
        elif raw.accel is not None:
            spool.append("accel_raw", _counts(raw.accel))
        warm = warm or block.temperature_c is not None
        no_temperature = np.full(n, np.nan)
        spool.append("temperature_c", no_temperature if block.temperature_c is None else block.temperature_c)
        spool.append("epoch", np.full(n, block.epoch))
        for name in ("seq", "device_us", "host_ns"):
            spool.append(name, getattr(block, name))
        spool.append("flags", np.zeros(n, np.int64) if block.flags is None else block.flags.astype(np.int64))
        rows += n
    if settings is None:
        return {}, 0
    rate_hz, lsb, accel_lsb, _ = settings
    if not accel_lsb or spool.length("accel_raw") != rows:
        spool.drop("accel_raw")
    if spool.length("accel_ms2") != rows:
        spool.drop("accel_ms2")
    if not warm:
        spool.drop("temperature_c")
    scales = {
        "fs_hz": rate_hz,
        "lsb_per_dps": lsb,
        "accel_lsb_per_g": accel_lsb if "accel_raw" in spool else None,
    }
    return {name: value for name, value in scales.items() if value is not None}, rows


def _counts(values: Values) -> NDArray[np.int32]:
    if np.abs(values.astype(np.float64)).max() >= 2**31:
        raise UsageError("its counts do not fit 32 bits; export it as .csv.")
    return values.astype(np.int32)


def gather_rows(spool: Spool, table: Table) -> int:
    """Write the columns of a table to `spool` as arrays; return the number of rows.

    Invalid values become NaN.
    """
    count = 0
    while rows := list(islice(table.rows, AT_ONCE)):
        for name, values in zip(table.columns, zip(*rows, strict=True), strict=True):
            kind: type | str = np.int64 if name in OF_ALL else np.float64
            if name in OF_TEXT:
                kind = f"U{MOST_TEXT}"
            spool.append(name, np.array([np.nan if value is None else value for value in values], dtype=kind))
        count += len(rows)
    return count


def _write_csv(file: BinaryIO, table: Table) -> int:
    count = 0
    with text_of(file) as text:
        writer = csv.writer(text)
        writer.writerow(table.columns)
        for row in table.rows:
            writer.writerow(row)
            count += 1
    return count
