"""Writes simulated noise and its true state to a file that `replay:` reads."""

import csv
import math
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.noise.simulation import FractionalNoise, quantise
from fltea.records.errors import FlteaError, UsageError
from fltea.records.records import AXES
from fltea.records.whole_file import text_of, whole_file


def write_simulation(
    out: Path,
    *,
    alpha: float,
    alpha_end: float,
    f: float,
    Q: float,
    R: float,
    n: int,
    rate_hz: float,
    axes: int,
    lsb_per_dps: float | None,
    range_dps: float,
    offset_dps: float,
    window: int,
    seed: int,
) -> None:
    """Write `n` samples of `axes` axes; the model and its units are those of `fltea.noise.simulation`.

    The file appears whole or not at all.

    Raises:
        UsageError: impossible parameters, or an ending that is neither .csv nor .npz.
        FlteaError: the file cannot be written, or the noise grew beyond all bounds.
    """
    _check_name(out)
    if n < 1 or not 1 <= axes <= len(AXES) or rate_hz <= 0:
        raise UsageError("simulate needs --samples ≥ 1, --axes 1 to 3 and --rate > 0.")
    for name, value in (("--alpha", alpha), ("--alpha-end", alpha_end), ("--offset", offset_dps)):
        if not math.isfinite(value):
            raise UsageError(f"simulate: {name} has to be a finite number, not {value}.")
    try:
        orders = np.linspace(alpha, alpha_end, n)
        y, x = np.empty((n, axes)), np.empty((n, axes))
        for i in range(axes):
            rng = np.random.default_rng((seed, i))
            noise = FractionalNoise(orders, f, Q, R, 1.0 / rate_hz, window, rng)
            y[:, i], x[:, i] = noise.samples(n)
        if not np.isfinite(y).all():
            raise FlteaError(f"α = {alpha:g}, f = {f:g} is not stationary: the noise grew beyond all bounds.")
        y, counts = _as_sensor(y, offset_dps, lsb_per_dps, range_dps)
    except (ValueError, MemoryError) as error:
        raise UsageError(f"simulate: {error}.") from error
    _write(out, y, x, orders, rate_hz, counts, lsb_per_dps)


def write_model_simulation(
    out: Path,
    model: Path,
    *,
    n: int,
    lsb_per_dps: float | None,
    range_dps: float,
    offset_dps: float,
    seed: int,
) -> None:
    """Write `n` samples of the axes that `fltea identify --export-model` wrote to the file `model`.

    The true state beside the samples is all that is not white; the order is in the model's own file.

    Raises:
        UsageError: no such model, impossible settings, or an ending that is neither .csv nor .npz.
        FlteaError: the file cannot be written.
    """
    from fltea.identification.model_file import read_models
    from fltea.identification.noise_model import draw

    _check_name(out)
    models = read_models(model)
    if not models.axes:
        raise UsageError(f"{model}: has no axis of a gyroscope, and nothing else is simulated.")
    if n < 1 or not math.isfinite(offset_dps):
        raise UsageError("simulate needs --samples ≥ 1 and a finite --offset.")
    try:
        y, x = np.empty((n, len(models.axes))), np.empty((n, len(models.axes)))
        for i, axis in enumerate(AXES[: len(models.axes)]):
            rng = np.random.default_rng((seed, i))
            y[:, i], x[:, i] = draw(models.axes[axis], models.h_s, n, rng)
        y, counts = _as_sensor(y, offset_dps, lsb_per_dps, range_dps)
    except (ValueError, MemoryError) as error:
        raise UsageError(f"simulate: {error}.") from error
    _write(out, y, x, None, models.rate_hz, counts, lsb_per_dps)


def _check_name(out: Path) -> None:
    if out.suffix.lower() not in (".csv", ".npz"):
        raise UsageError(f"{out}: give a name that ends in .csv or .npz.")


def _as_sensor(
    y: NDArray[np.float64], offset_dps: float, lsb_per_dps: float | None, range_dps: float
) -> tuple[NDArray[np.float64], NDArray[np.int16] | None]:
    """Return the samples with their offset in deg/s and, if they are quantised, in counts."""
    y = y + offset_dps
    if lsb_per_dps is None:
        return y, None
    counts = quantise(y, lsb_per_dps, range_dps)
    return counts / lsb_per_dps, counts


def _write(
    out: Path,
    y: NDArray[np.float64],
    x: NDArray[np.float64],
    orders: NDArray[np.float64] | None,
    rate_hz: float,
    counts: NDArray[np.int16] | None,
    lsb_per_dps: float | None,
) -> None:
    with whole_file(out) as file:
        if out.suffix.lower() == ".csv":
            _write_csv(file, y, x, orders, rate_hz)
        else:
            _write_npz(file, y, x, orders, rate_hz, counts, lsb_per_dps)


def _write_csv(
    file: BinaryIO,
    y: NDArray[np.float64],
    x: NDArray[np.float64],
    orders: NDArray[np.float64] | None,
    rate_hz: float,
) -> None:
    names = AXES[: y.shape[1]]
    header = ["time_s", *[f"{a}_dps" for a in names], *[f"true_state_{a}_dps" for a in names]]
    columns = [y, x]
    if orders is not None:
        header.append("true_alpha")
        columns.append(orders[:, np.newaxis])
    table = np.hstack(columns)
    with text_of(file) as text:
        rows = csv.writer(text)
        rows.writerow(header)
        for k, row in enumerate(table):
            rows.writerow([repr(k / rate_hz), *row.tolist()])


def _write_npz(
    file: BinaryIO,
    y: NDArray[np.float64],
    x: NDArray[np.float64],
    orders: NDArray[np.float64] | None,
    rate_hz: float,
    counts: NDArray[np.int16] | None,
    lsb_per_dps: float | None,
) -> None:
    data: dict[str, ArrayLike] = {"fs_hz": rate_hz, "true_state_dps": x}
    if orders is not None:
        data["true_alpha"] = orders
    if counts is None:
        data["gyro_dps"] = y
    else:
        data["gyro_raw"], data["lsb_per_dps"] = counts, float(lsb_per_dps or 0.0)
    np.savez_compressed(file, allow_pickle=False, **data)
