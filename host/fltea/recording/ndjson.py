"""Reads the records `hello`, `epoch`, `sample`, `step` and `motion` from fltea's own NDJSON output."""

from pathlib import Path
from typing import Any, BinaryIO

import msgspec

from fltea.recording.changes import CLASSES, MotionMark, StepMark
from fltea.recording.files import LARGEST_DPS
from fltea.recording.kind import is_stream
from fltea.recording.raw_lines import lines
from fltea.recording.session import LATEST_NS, check_hello
from fltea.records.errors import UsageError
from fltea.records.records import ACCEL_AXES, AXES, EpochReason, Hello, Record, Sample
from fltea.settings.limits import DEFAULT_LIMITS, Limits


class EpochMark(Record, frozen=True, forbid_unknown_fields=False, tag="epoch"):
    """Fields of an `epoch` record that a replay needs. Other versions of fltea may write further fields."""

    reason: EpochReason
    host_ns: int


Kept = Hello | EpochMark | Sample | StepMark | MotionMark


def read_ndjson(
    path: Path, *, limits: Limits = DEFAULT_LIMITS, file: BinaryIO | None = None
) -> tuple[list[Kept], str | None]:
    """Read the records in fltea's own output that a replay needs.

    `file`: the open file, if the caller has opened it.

    Returns the records, and a warning if the last line is truncated and was left out, for instance after a
    power failure; else None.

    Raises:
        UsageError: a line is damaged or too long, samples come before a hello, there are no samples (they are
            recorded only with --samples), or a pipe sends more than the limits allow.
    """
    most = limits.whole_bytes if is_stream(path) else None
    kept = 0
    records: list[Kept] = []
    cut = None
    try:
        with file or path.open("rb") as opened:
            for number, line in enumerate(lines(path, opened), 1):
                record = _parse(path, number, line)
                if record is None:
                    cut = f"{path}:{number}: the last line is cut off; the replay ends before it."
                elif record["class"] in ("hello", "epoch", "sample", *CLASSES):
                    records.append(_convert(path, number, record, records))
                    kept += len(line)
                    if most is not None and kept > most:
                        raise limits.whole_too_large(f"{path}:{number}", kept)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error}).") from error
    devices = sorted({record.device for record in records if record.device is not None})
    if len(devices) > 1:
        raise UsageError(
            f"{path}: holds several devices ({', '.join(devices)}), and one can be replayed. Extract its "
            f'lines: grep \'"device":"{devices[0]}"\'.'
        )
    if not any(isinstance(record, Sample) for record in records):
        raise UsageError(f"{path}: holds no sample records; write them with 'fltea run --samples'.")
    return records, cut


def _parse(path: Path, number: int, line: bytes) -> dict[str, Any] | None:
    """Return a line as an object; None if it is a truncated last line."""
    try:
        record = msgspec.json.decode(line)  # this decoder refuses NaN, which json.loads accepts
    except (ValueError, RecursionError) as error:  # the line is damaged, or nested too deeply
        if number > 1 and not line.endswith(b"\n"):
            return None
        raise UsageError(f"{path}:{number}: is not JSON ({error}).") from error
    if not isinstance(record, dict) or "class" not in record:
        raise UsageError(f"{path}:{number}: is not a record of fltea (no key 'class').")
    return record


def _convert(path: Path, number: int, record: dict[str, Any], before: list[Kept]) -> Kept:
    try:
        item: Kept = msgspec.convert(record, Kept)
        if abs(item.host_ns) > LATEST_NS:
            raise ValueError("an impossible time")
        if isinstance(item, Hello):
            check_hello(item)
        elif isinstance(item, Sample):
            _check_sample(item, before)
    except (ValueError, RecursionError) as error:  # msgspec's ValidationError is a ValueError
        raise UsageError(f"{path}:{number}: is a damaged record ({error}).") from error
    return item


def _check_sample(sample: Sample, before: list[Kept]) -> None:
    if not before or not any(isinstance(record, Hello) for record in before[:1]):
        raise ValueError("a sample before any hello; its rate is not known")
    last = before[-1]
    axes = len(last.gyro_dps) if isinstance(last, Sample) else None
    if not 1 <= len(sample.gyro_dps) <= len(AXES) or axes not in (None, len(sample.gyro_dps)):
        raise ValueError(f"gyro_dps has {len(sample.gyro_dps)} axes" + (f", {axes} before" if axes else ""))
    if sample.accel_ms2 is not None and len(sample.accel_ms2) != len(ACCEL_AXES):
        raise ValueError(f"accel_ms2 has {len(sample.accel_ms2)} axes")
    if max(map(abs, sample.gyro_dps)) > LARGEST_DPS:
        raise ValueError(f"more than {LARGEST_DPS:g} deg/s")
    if max(map(abs, (*(sample.accel_ms2 or ()), sample.temperature_c or 0.0))) > LARGEST_DPS:
        raise ValueError(f"more than {LARGEST_DPS:g} m/s² or °C")
    whole = sample.seq, sample.device_us, sample.epoch, sample.flags
    if max(map(abs, whole)) > LATEST_NS:
        raise ValueError("impossible numbers")
