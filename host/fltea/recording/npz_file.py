"""Reads and checks .npz recordings in the form that `fltea export` writes."""

import math
from collections.abc import Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fltea.recording.files import (
    AT_ONCE,
    HOST_TOLERANCE,
    LARGEST_COUNT,
    LARGEST_DPS,
    LARGEST_NUMBER,
    Recording,
    Stored,
    check_span,
    listed,
)
from fltea.recording.npz_arrays import NpzArrays
from fltea.recording.reading import Answer
from fltea.recording.sample_times import LONGEST_S
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.settings.limits import DEFAULT_LIMITS, Limits

BESIDE = ("t_host_s", "accel_raw", "accel_ms2", "time_s", "seq", "epoch")
"""Optional arrays of an .npz recording that have a row for each sample."""

LEAST_POSITIVE = 1e-9
"""Smallest accepted sampling rate or scale. Counts divided by a smaller number might not be finite."""
NPZ_ARRAYS = ("gyro_raw", "gyro_dps", "fs_hz", "lsb_per_dps", "accel_lsb_per_g", *BESIDE)
"""All arrays that are read; other arrays in a file are ignored."""


def open_npz(path: Path, limits: Limits = DEFAULT_LIMITS) -> Stored:
    """Open and check a recording of arrays with the names that `fltea export` writes.

    Necessary are `fs_hz` (sampling rate), and either `gyro_dps`, or `gyro_raw` with `lsb_per_dps`. Optional
    are `t_host_s` (arrival times), and accelerations: either `accel_ms2`, or `accel_raw` with
    `accel_lsb_per_g`. A recording with gaps also has `time_s` (times by the device's clock), `seq` and
    `epoch`.

    Raises:
        UsageError: the file is not such a recording, holds numbers that are not finite, or exceeds the
            limits.
    """
    arrays = NpzArrays(path, NPZ_ARRAYS, limits)
    key = next((k for k in ("gyro_raw", "gyro_dps") if k in arrays), None)
    needed = ["fs_hz"] + (["lsb_per_dps"] if key == "gyro_raw" else [])
    missing = [k for k in needed if k not in arrays] + ([] if key else ["gyro_raw or gyro_dps"])
    if key is None or missing:
        has = listed(arrays.names) or "nothing"
        raise UsageError(f"{path}: has no {', '.join(missing)} (it holds {has}).")
    shape = arrays.shape(key)
    if len(shape) != 2 or not 1 <= shape[1] <= len(AXES):
        raise UsageError(f"{path}: {key} has the shape {shape}; (samples, 1 to 3 axes) is needed.")
    if shape[0] == 0:
        raise UsageError(f"{path}: {key} has no rows.")
    n = shape[0]
    columns = [key]
    for name in filter(arrays.__contains__, BESIDE):
        columns.append(name)
        alike = (n, 3) if name.startswith("accel") else (n,)
        if arrays.shape(name) != alike:
            raise UsageError(
                f"{path}: {name} has the shape {arrays.shape(name)}; {alike} is needed, as {key} has."
            )
    rate_hz = _positive(path, "fs_hz", arrays)
    lsb = _positive(path, "lsb_per_dps", arrays) if key == "gyro_raw" else None
    accel_lsb = _positive(path, "accel_lsb_per_g", arrays) if "accel_lsb_per_g" in arrays else None
    like = Recording(np.empty((0, shape[1])), rate_hz, np.empty(0), lsb, accel_lsb_per_g=accel_lsb)
    blocks = partial(_npz_blocks, path, arrays, columns, like)
    stored = Stored(n, rate_hz, lsb, accel_lsb, blocks, reading=_reading(key, columns, like))
    check = _Check(path, key)
    for block in stored.blocks():
        check.add(block)
    check.end()
    return stored


def _reading(key: str, columns: Collection[str], like: Recording) -> tuple[Answer, ...]:
    """Return the answers on columns, unit and rate, which the names of the arrays give.

    In such a file, each name has one fixed meaning.
    """
    unit, by = ("deg/s", key) if like.lsb_per_dps is None else (f"lsb:{like.lsb_per_dps:g}", "lsb_per_dps")
    found = [
        Answer("columns", f"{key} as {', '.join('xyz'[: like.gyro.shape[1]])}", "stated", "its name"),
        Answer("unit", unit, "stated", by),
        Answer("clock", f"{like.rate_hz:.6g} Hz", "stated", "fs_hz"),
    ]
    accel = next((name for name in ("accel_raw", "accel_ms2") if name in columns), None)
    if accel is not None:
        by = "accel_lsb_per_g" if accel == "accel_raw" else accel
        has_scale = accel == "accel_ms2" or like.accel_lsb_per_g is not None
        says = accel if has_scale else f"{accel}, not read: its scale accel_lsb_per_g is not in the file"
        found.append(Answer("accelerometer", says, "stated", by if has_scale else "its name"))
    return tuple(found)


def _npz_blocks(path: Path, arrays: NpzArrays, columns: list[str], like: Recording) -> Iterator[Recording]:
    """Yield the rows of a recording in blocks."""
    row = 0
    for block in arrays.rows(columns, AT_ONCE):
        found = {name: _numeric(path, name, values, row) for name, values in block.items()}
        gyro = found[columns[0]]
        n = len(gyro)
        device_s = found["time_s"] if "time_s" in found else np.arange(row, row + n) / like.rate_hz
        numbers: dict[str, Any] = {}
        for name in ("seq", "epoch"):
            if name in found and np.abs(found[name]).max() > LARGEST_NUMBER:
                raise UsageError(
                    f"{path}: {name} holds numbers beyond 53 bits, which cannot be numbers of samples."
                )
            if name in found and "time_s" in found:
                numbers[name] = found[name].astype(np.int64)
        yield like._replace(
            gyro=gyro,
            device_s=device_s,
            host_s=found.get("t_host_s"),
            accel=found.get("accel_raw"),
            accel_ms2=found.get("accel_ms2"),
            **numbers,
        )
        row += n


class _Check:
    """Checks the blocks of an .npz recording one after the other."""

    def __init__(self, path: Path, key: str) -> None:
        self._path, self._key = path, key
        self._rows = 0
        self._first: tuple[float, float] | None = None
        self._last = (-math.inf, -math.inf)
        self._seq, self._epoch = -1.0, math.nan
        self._rate_hz = 0.0
        self._has_host = False

    def add(self, block: Recording) -> None:
        """Check the next block; raise UsageError for impossible values."""
        path, key = self._path, self._key
        counts = block.gyro if block.lsb_per_dps is not None else None
        for name, extra in ((key, counts), ("accel_raw", block.accel), ("accel_ms2", block.accel_ms2)):
            if extra is not None and np.abs(extra).max() >= LARGEST_COUNT:
                raise UsageError(
                    f"{path}: {name} holds numbers beyond 32 bits, which are no sensor's counts."
                )
        self._rate_hz, self._has_host = block.rate_hz, block.host_s is not None
        host_s = block.device_s if block.host_s is None else block.host_s
        if self._first is None:
            self._first = float(block.device_s[0]), float(host_s[0])
        stands = np.diff(block.device_s, prepend=self._last[0]) <= 0
        seq = np.arange(len(host_s)) if block.seq is None else block.seq
        epoch = np.zeros(len(host_s)) if block.epoch is None else block.epoch
        lost = np.where(np.diff(epoch, prepend=self._epoch) == 0, np.diff(seq, prepend=self._seq) - 1, 0)
        took = np.diff(block.device_s, prepend=self._last[0]) * block.rate_hz - 1
        # The times must leave room for half of the samples that `seq` skips, less one: stamps of messages are
        # wrong by up to one period.
        lacks = (lost > 0) & (took < lost / 2 - 1)
        self._seq, self._epoch = float(seq[-1]) if block.seq is not None else -1.0, float(epoch[-1])
        beyond = np.abs(block.gyro).max(axis=1) > LARGEST_DPS * (block.lsb_per_dps or 1.0)
        for bad, what in (
            (stands, "time_s does not increase"),
            (np.abs(block.device_s) > LONGEST_S, f"time_s is beyond {LONGEST_S:g} s"),
            (np.diff(host_s, prepend=self._last[1]) < 0, "t_host_s runs backwards"),
            (lacks, "seq skips samples for which time_s leaves no time"),
            (beyond, f"{key} is more than {LARGEST_DPS:g} deg/s"),
        ):
            if bad.any():
                raise UsageError(f"{path}: {what} in row {self._rows + int(np.argmax(bad))}.")
        self._last = float(block.device_s[-1]), float(host_s[-1])
        self._rows += len(host_s)

    def end(self) -> None:
        """Check that the arrival times span about the duration that the stated rate gives."""
        assert self._first is not None
        expected_s, seconds = (last - first for last, first in zip(self._last, self._first, strict=True))
        check_span(self._path, self._rate_hz, self._rows, expected_s)
        if self._has_host and abs(seconds - expected_s) > HOST_TOLERANCE * expected_s + 1.0:
            raise UsageError(
                f"{self._path}: t_host_s spans {seconds:.6g} s, but {self._rows} samples at fs_hz = "
                f"{self._rate_hz:.6g} take {expected_s:.6g} s: one of the two is wrong, or samples are "
                "missing."
            )


def _numeric(path: Path, name: str, array: NDArray[Any], first: int = 0) -> NDArray[np.float64]:
    """Return `array` as floats; raise UsageError unless all its numbers are finite.

    `first`: row number of the array's first value, for messages.
    """
    values = np.asarray(array, dtype=np.float64)
    finite = np.isfinite(np.atleast_1d(values))
    if not finite.all():
        row = first + int(np.unravel_index(int(np.argmin(finite)), finite.shape)[0])
        raise UsageError(f"{path}: {name} is not finite in row {row}.")
    return values


def _positive(path: Path, name: str, arrays: NpzArrays) -> float:
    values = _numeric(path, name, arrays.whole(name)) if math.prod(arrays.shape(name)) == 1 else None
    if values is None or values.item() < LEAST_POSITIVE:
        raise UsageError(f"{path}: {name} has to be one positive number, of {LEAST_POSITIVE:g} or more.")
    return float(values.item())
