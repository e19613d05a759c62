"""Turns records that were published during a recording into table rows.

These records are estimates, fits, steps and motions.
"""

from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import msgspec

from fltea.archive.corrected import corrected
from fltea.recording.session import Whole
from fltea.records.errors import UsageError
from fltea.records.fit import AxisFit, Interval
from fltea.records.records import ACCEL_AXES, AXES, Corrected
from fltea.records.sensor_kind import kind_of
from fltea.settings.duration import Duration

if TYPE_CHECKING:
    from fltea.sources.mcap import McapRecording

Axis = Annotated[str, msgspec.Meta(pattern=f"^({'|'.join(AXES + ACCEL_AXES)})$")]


What = Literal["samples", "corrected", "estimates", "device_estimates", "fits", "steps", "motions"]
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
    "fltea.alpha": "alpha_{axis}",
    "fltea.alpha_std": "alpha_std_{axis}",
    "fltea.f": "f_{axis}_s^-alpha",
    "fltea.f_std": "f_std_{axis}_s^-alpha",
    "fltea.state": "state_{axis}_{unit}",
    "fltea.innovation": "innovation_{axis}_{unit}",
    "fltea.valid": "valid_{axis}",
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
"""For each kind of record: the fields that it has for every axis, with their columns in an exported table."""

OF_A_FIT = {
    "alpha": "alpha{end}_{axis}",
    "f": "f{end}_{axis}_s^-alpha",
    "F": "F{end}_{axis}",
    "s2": "s2{end}_{axis}_{unit}^2",
    "R": "R{end}_{axis}_{unit}^2",
}
"""Columns for the parameters of an axis in a fit: the value and both ends of its interval."""

OF_ALL = ("epoch", "seq", "device_us", "host_ns")

OF_A_CHANGE = {
    "steps": {name: name for name in ("axis", "unit", "size", "size_std", "found_after")},
    "motions": {"begins": "begins", "by": "by", "samples": "samples", "largest": "largest_dps"},
}
"""Columns for the fields of steps and motions."""

MOST_TEXT = 40
"""Longest text in a column [characters]."""

OF_TEXT = ("axis", "unit", "by")
"""Columns that hold text."""


class Table(NamedTuple):
    """The names of a table's columns, and its rows."""

    columns: list[str]
    rows: Iterator[list[Any]]


def published_table(paths: Sequence[Path], source: Any, what: What, max_gap: Duration) -> Table:
    """Return a table with one row for each published record, or for each sample with corrected rates.

    Values that are invalid, or that the data did not determine, stay empty.
    `what`: the kind of records to export; "device_estimates" are the estimates that the device itself
    computed.

    Raises:
        UsageError: there is no recording, or it has no such records.
    """
    if what in OF_A_CHANGE:
        return _changes_table(paths, source, what)
    records: Iterator[Corrected | _Estimate | _Fit] = (
        corrected(source, max_gap) if what == "corrected" else _published(source, what.removesuffix("s"))
    )
    first = next(records, None)
    if first is None:
        of_samples = f"{what}. Compute them from its samples: fltea run -s replay:{paths[0]}"
        missing = {
            "corrected": "samples that can be used.",
            "device_estimates": "estimates that a device computed (recorded with --estimate-on both).",
        }
        raise UsageError(f"{paths[0]}: holds no {missing.get(what, of_samples)}")
    units = {axis: kind_of(axis).column_unit for axis in first.axes}
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


def _changes_table(paths: Sequence[Path], source: "McapRecording | None", what: What) -> Table:
    """Return a table with one row for each bias step, or for each beginning and end of a motion.

    The column `host_ns` holds the time of the step, or of the beginning or end of the motion.
    """
    records = _published(source, what.removesuffix("s"))
    first = next(records, None)
    if first is None:
        raise UsageError(
            f"{paths[0]}: holds no {what}: there were none, or it was recorded without estimating "
            f"(fltea record). Look for them in its samples: fltea run -s replay:{paths[0]}"
        )
    named = OF_A_CHANGE[what]

    def rows() -> Iterator[list[Any]]:
        for record in chain([first], records):
            values = (getattr(record, name) for name in named)
            of_all = (getattr(record, name) for name in OF_ALL)
            yield [*of_all, *(int(value) if isinstance(value, bool) else value for value in values)]

    return Table([*OF_ALL, *named.values()], rows())


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


class _Published(msgspec.Struct, frozen=True):
    """Fields that all records about a sample have."""

    host_ns: Whole
    device_us: Whole
    seq: Whole
    epoch: Whole


class _Estimate(_Published, frozen=True):
    axes: dict[Axis, dict[str, int | float | bool | str | dict[str, Any] | None]] = {}


class _Fit(_Published, frozen=True):
    samples: Whole
    axes: dict[Axis, AxisFit] = {}


class _Step(_Published, frozen=True):
    axis: Axis
    unit: Literal["deg/s", "m/s^2"]
    size: float
    size_std: float
    found_after: Whole


class _Motion(_Published, frozen=True):
    begins: bool
    by: Annotated[str, msgspec.Meta(max_length=MOST_TEXT)]
    samples: Whole | None = None
    largest: float | None = None


_DECODERS: dict[str, msgspec.json.Decoder[Any]] = {
    "estimate": msgspec.json.Decoder(_Estimate),
    "device_estimate": msgspec.json.Decoder(_Estimate),
    "fit": msgspec.json.Decoder(_Fit),
    "step": msgspec.json.Decoder(_Step),
    "motion": msgspec.json.Decoder(_Motion),
}


def _published(recording: "McapRecording | None", topic: str) -> Iterator[Any]:
    """Yield the records of one kind in a recording, as they were published."""
    decode = _DECODERS[topic].decode
    for part, entry in recording.entries() if recording is not None else ():
        if entry.topic == topic:
            try:
                yield decode(entry.data)
            except (ValueError, RecursionError) as error:  # the JSON is damaged or nested too deeply
                raise UsageError(f"{part.path}: a {topic} in it is damaged ({error}).") from error


def _number(value: float | bool | str | None) -> float | None:
    """Return a value as a number: 1 for true and for "rejected", 0 for false and for other texts."""
    if isinstance(value, str):
        value = value == "rejected"
    return int(value) if isinstance(value, bool) else value
