"""A recording as a table: CSV, or arrays in an npz file, with the units in the names.

Samples are decoded again from the raw bytes, which are always there and lose nothing; so are the rates less
their biases, which follow from them. Estimates are taken from their JSON channel as they were published,
since they depend on the settings of that run; `fltea run` on the recording makes others.
"""

import csv
import os
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, BinaryIO, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.archive.corrected import corrected
from fltea.recording.files import AT_ONCE
from fltea.recording.kind import is_one_file
from fltea.recording.session import Whole
from fltea.recording.spool import Spool
from fltea.records.errors import UsageError
from fltea.records.events import Values
from fltea.records.fit import AxisFit, Interval
from fltea.records.records import ACCEL_AXES, AXES, Corrected
from fltea.records.whole_file import text_of, whole_file
from fltea.settings.duration import Duration
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits
from fltea.sources.replay import ReplaySource, open_mcap
from fltea.stream.decode import Decoded, Decoder

if TYPE_CHECKING:
    from fltea.sources.mcap import McapRecording

Axis = Annotated[str, msgspec.Meta(pattern=f"^({'|'.join(AXES + ACCEL_AXES)})$")]

Array = NDArray[np.float64]
What = Literal["samples", "corrected", "estimates", "device_estimates", "fits"]
OF_AN_AXIS = {
    "bias": "bias_{axis}_{unit}",
    "bias_std": "bias_std_{axis}_{unit}",
    "state": "state_{axis}_{unit}",
    "state_std": "state_std_{axis}_{unit}",
    "innovation": "innovation_{axis}_{unit}",
    "moving": "moving_{axis}",
    "null_p": "null_p_{axis}",
    "whiteness": "not_white_{axis}",
    "fltea.alpha": "fltea_alpha_{axis}",
    "fltea.alpha_std": "fltea_alpha_std_{axis}",
    "fltea.f": "fltea_f_{axis}_s^-alpha",
    "fltea.f_std": "fltea_f_std_{axis}_s^-alpha",
    "fltea.state": "fltea_state_{axis}_{unit}",
    "fltea.innovation": "fltea_innovation_{axis}_{unit}",
    "fltea.valid": "fltea_valid_{axis}",
    "fltea.settled": "fltea_settled_{axis}",
}
OF_A_DEVICE_AXIS = {
    "alpha": "alpha_{axis}",
    "alpha_std": "alpha_std_{axis}",
    "f": "f_{axis}_s^-alpha",
    "f_std": "f_std_{axis}_s^-alpha",
    "state": "state_{axis}_{unit}",
    "innovation": "innovation_{axis}_{unit}",
    "valid": "valid_{axis}",
    "age": "age_{axis}",
    "tracker_bias": "tracker_bias_{axis}_{unit}",
    "tracker_bias_std": "tracker_bias_std_{axis}_{unit}",
    "tracker_state": "tracker_state_{axis}_{unit}",
    "tracker_state_std": "tracker_state_std_{axis}_{unit}",
    "tracker_bias_difference": "tracker_bias_difference_{axis}_{unit}",
    "alpha_difference": "alpha_difference_{axis}",
    "f_difference": "f_difference_{axis}_s^-alpha",
    "state_difference": "state_difference_{axis}_{unit}",
}
OF_A_CORRECTED_AXIS = {
    "rate": "rate_{axis}_{unit}",
    "rate_std": "rate_std_{axis}_{unit}",
    "moving": "moving_{axis}",
}
NAMED = {"estimates": OF_AN_AXIS, "device_estimates": OF_A_DEVICE_AXIS, "corrected": OF_A_CORRECTED_AXIS}
"""Fields of an axis in a record, and the columns that they become."""

OF_A_FIT = {
    "alpha": "alpha{end}_{axis}",
    "f": "f{end}_{axis}_s^-alpha",
    "F": "F{end}_{axis}",
    "s2": "s2{end}_{axis}_{unit}^2",
    "R": "R{end}_{axis}_{unit}^2",
}
"""Parameters of an axis in a fit, and the columns that each becomes: value, low and high."""

OF_ALL = ("epoch", "seq", "device_us", "host_ns")


class Exported(NamedTuple):
    """How many rows were written, and why files of the recording could not be read, or not all of them."""

    rows: int
    unread: list[str]


class Table(NamedTuple):
    """The names of a table's columns, and its rows as they come."""

    columns: list[str]
    rows: Iterator[list[Any]]


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
    """Write samples or estimates of one recording; the file appears whole or not at all.

    force: replace what is at `out` already. how: what is said of the recording.

    Raises:
        UsageError: no recording, nothing of what was asked for in it, another ending than .csv and .npz, or
            a file that exists already, or a recording that would take more memory than the limits allow.
        FlteaError: the file cannot be written.
    """
    suffix = out.suffix.lower()
    if suffix not in (".csv", ".npz"):
        raise UsageError(f"--to {out}: give a name that ends in .csv or .npz.")
    if not force and os.path.lexists(out):  # a link that leads nowhere is something, too
        raise UsageError(f"--to {out}: exists already; give another name, or --force to replace it.")
    with whole_file(out) as file:
        was_published = what not in ("samples", "corrected")  # which no file of another program holds
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
    """Yield the samples of a recording of any kind."""
    decoder = Decoder(lambda: int(source.unix_offset_ns), max_gap)
    for event in source.events():
        for found in decoder.feed(event):
            if isinstance(found, Decoded):
                yield found


def _source(paths: Sequence[Path], limits: Limits, how: How) -> Any:
    """Return what gives the events of a recording of any kind."""
    if len(paths) == 1 and is_one_file(paths[0]):
        return ReplaySource(paths[0], how=how, limits=limits)
    return open_mcap(paths, f"replay:{paths[0]}", limits)()


class DeviceTime:
    """The seconds since the first sample by the device's clock, bridged by the host's where it restarts."""

    def __init__(self) -> None:
        self._origin_us: int | None = None
        self._base_s = 0.0
        self._first_ns = 0
        self._last: tuple[int, int, float] = (0, 0, 0.0)

    def add(self, found: Decoded) -> Array:
        """Return times of the next samples [s], (n,); they always increase."""
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
    """Return a table with one row a sample; what a recording does not have stays empty."""
    columns = ["time_s", *(f"{axis}_dps" for axis in AXES), *(f"{axis}_ms2" for axis in ACCEL_AXES)]
    columns += ["temperature_c", "epoch", "seq", "device_us", "host_ns", "flags"]

    def rows() -> Iterator[list[Any]]:
        clock = DeviceTime()
        for found in decoded:
            times = np.round(clock.add(found), 6).tolist()
            for time_s, s in zip(times, found.block.samples(), strict=True):
                gyro = [*s.gyro_dps, *([None] * (len(AXES) - len(s.gyro_dps)))]
                accel = s.accel_ms2 or (None,) * len(ACCEL_AXES)
                place = s.epoch, s.seq, s.device_us, s.host_ns, s.flags
                yield [time_s, *gyro, *accel, s.temperature_c, *place]

    return Table(columns, rows())


def gather_samples(spool: Spool, decoded: Iterable[Decoded]) -> tuple[dict[str, float], int]:
    """Gather the arrays that `replay:` reads (host/docs/guide/sources.md); their scales, and their length.

    Raises:
        UsageError: rate or scale change within the recording; an npz file has one of each.
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


def published_table(paths: Sequence[Path], source: Any, what: What, max_gap: Duration) -> Table:
    """Return a table with one row a record: as published, estimates of either kind, fits; or corrected rates.

    What was not valid, or the data did not define, stays empty. what: "device_estimates" are those that the
    device made beside the host's.

    Raises:
        UsageError: no recording, or one without such records.
    """
    records: Iterator[Corrected | _Estimate | _Fit] = (
        corrected(source, max_gap) if what == "corrected" else _published(source, what.removesuffix("s"))
    )
    first = next(records, None)
    if first is None:
        of_samples = f"{what}. Make them of its samples: fltea run -s replay:{paths[0]}"
        missing = {
            "corrected": "samples that can be used.",
            "device_estimates": "estimates of a device beside the host's (--estimate-on both).",
        }
        raise UsageError(f"{paths[0]}: holds no {missing.get(what, of_samples)}")
    units = {axis: "ms2" if axis in ACCEL_AXES else "dps" for axis in first.axes}
    columns = ["time_s", *OF_ALL]
    if isinstance(first, _Fit):
        columns += ["samples", *(name for axis, unit in units.items() for name in _fit_columns(axis, unit))]
    named = NAMED.get(what, {})
    places = [(axis, field) for axis in units for field in named]
    if not isinstance(first, _Fit):
        columns += [named[field].format(axis=axis, unit=units[axis]) for axis, field in places]

    def rows() -> Iterator[list[Any]]:
        for record in chain([first], records):
            time_s = round((record.host_ns - first.host_ns) * 1e-9, 9)
            row = [time_s, *(getattr(record, name) for name in OF_ALL)]
            if not isinstance(record, _Fit):
                row += [_number(_of_axis(record.axes.get(axis), field)) for axis, field in places]
            else:
                row += [record.samples, *(x for axis in units for x in _fit_values(record.axes.get(axis)))]
            yield row

    return Table(columns, rows())


def _of_axis(found: Any, path: str) -> Any:
    for name in path.split("."):
        found = found.get(name) if isinstance(found, dict) else getattr(found, name, None)
    return found


def _fit_columns(axis: str, unit: str) -> list[str]:
    ends = [(name, end) for name in OF_A_FIT.values() for end in ("", "_low", "_high")]
    named = [name.format(end=end, axis=axis, unit=unit) for name, end in ends]
    return [f"fractional_{axis}", f"null_p_{axis}", *named]


def _fit_values(one: AxisFit | None) -> list[float | None]:
    row: list[float | None] = [None, None] if one is None else [int(one.verdict == "fractional"), one.null_p]
    for field in OF_A_FIT:
        p = Interval() if one is None else getattr(one, field)
        row += [p.value, p.low, p.high]
    return row


def gather_rows(spool: Spool, table: Table) -> int:
    """Return the same as arrays with NaN for what was not valid, and their length."""
    count = 0
    while rows := list(islice(table.rows, AT_ONCE)):
        for name, values in zip(table.columns, zip(*rows, strict=True), strict=True):
            kind = np.int64 if name in OF_ALL else np.float64
            spool.append(name, np.array([np.nan if value is None else value for value in values], dtype=kind))
        count += len(rows)
    return count


class _Published(msgspec.Struct, frozen=True):
    """What every record has that belongs to a sample, null fields left out."""

    host_ns: Whole
    device_us: Whole
    seq: Whole
    epoch: Whole


class _Estimate(_Published, frozen=True):
    axes: dict[Axis, dict[str, int | float | bool | str | dict[str, Any] | None]] = {}


class _Fit(_Published, frozen=True):
    samples: Whole
    axes: dict[Axis, AxisFit] = {}


_estimate, _fit = msgspec.json.Decoder(_Estimate), msgspec.json.Decoder(_Fit)


def _published(recording: "McapRecording | None", topic: str) -> Iterator[_Estimate | _Fit]:
    """Yield the records of one kind in a recording, as they were published."""
    decode = _fit.decode if topic == "fit" else _estimate.decode
    for part, entry in recording.entries() if recording is not None else ():
        if entry.topic == topic:
            try:
                yield decode(entry.data)
            except (ValueError, RecursionError) as error:  # msgspec's errors, and brackets in brackets
                raise UsageError(f"{part.path}: a {topic} in it is damaged ({error}).") from error


def _number(value: float | bool | str | None) -> float | None:
    """Return a value as a number: 1 and 0 for true and false, also for rejected white noise."""
    if isinstance(value, str):
        value = value == "rejected"
    return int(value) if isinstance(value, bool) else value


def _write_csv(file: BinaryIO, table: Table) -> int:
    count = 0
    with text_of(file) as text:
        writer = csv.writer(text)
        writer.writerow(table.columns)
        for row in table.rows:
            writer.writerow(row)
            count += 1
    return count
