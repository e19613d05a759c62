"""Writes simulated noise and its true state to a file that `replay:` reads."""

import contextlib
import csv
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fltea.noise.simulation import FractionalNoise, quantise
from fltea.records.arrays import Array
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.records.whole_file import text_of, whole_file


class AsSensor(NamedTuple):
    """What a sensor adds to its noise: an offset and, if it counts, counts within its range."""

    lsb_per_dps: float | None
    range_dps: float
    offset_dps: float


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
        UsageError: impossible parameters, noise that runs away, or an ending that is neither .csv nor .npz.
        FlteaError: the file cannot be written.
    """
    sensor = AsSensor(lsb_per_dps, range_dps, offset_dps)
    _check(out, n, sensor)
    if not 1 <= axes <= len(AXES) or rate_hz <= 0:
        raise UsageError("simulate needs --axes 1 to 3 and --rate > 0.")
    for name, value in (("--alpha", alpha), ("--alpha-end", alpha_end)):
        if not math.isfinite(value):
            raise UsageError(f"simulate: {name} has to be a finite number, not {value}.")
    with _impossible():
        orders = np.linspace(alpha, alpha_end, n)

    def draw(axis: int) -> tuple[Array, Array]:
        rng = np.random.default_rng((seed, axis))
        return FractionalNoise(orders, f, Q, R, 1.0 / rate_hz, window, rng).samples(n)

    _simulate(out, draw, axes, orders, rate_hz, sensor)


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

    sensor = AsSensor(lsb_per_dps, range_dps, offset_dps)
    _check(out, n, sensor)
    models = read_models(model)
    if not models.axes:
        raise UsageError(f"{model}: has no gyroscope axis, and only these are simulated.")

    def drawn(axis: int) -> tuple[Array, Array]:
        return draw(models.axes[AXES[axis]], models.h_s, n, np.random.default_rng((seed, axis)))

    _simulate(out, drawn, len(models.axes), None, models.rate_hz, sensor)


@contextlib.contextmanager
def _impossible() -> Iterator[None]:
    """Tell what cannot be drawn, or takes more memory than there is."""
    try:
        with np.errstate(all="ignore"):  # what is no number in the end is reported
            yield
    except (ValueError, ArithmeticError, MemoryError) as error:
        raise UsageError(f"simulate: {error}.") from error


def _check(out: Path, n: int, sensor: AsSensor) -> None:
    if out.suffix.lower() not in (".csv", ".npz"):
        raise UsageError(f"{out}: give a name that ends in .csv or .npz.")
    if n < 1:
        raise UsageError("simulate needs --samples ≥ 1.")
    if not math.isfinite(sensor.offset_dps):
        raise UsageError(f"simulate: --offset has to be a finite number, not {sensor.offset_dps}.")


def _simulate(
    out: Path,
    draw: Callable[[int], tuple[Array, Array]],
    axes: int,
    orders: Array | None,
    rate_hz: float,
    sensor: AsSensor,
) -> None:
    """Draw samples and states of each axis, and write them with the order of each sample, if it is known."""
    with _impossible():
        y, x = (np.stack(one, axis=1) for one in zip(*map(draw, range(axes)), strict=True))
        y, counts = y + sensor.offset_dps, None
        if sensor.lsb_per_dps is not None:
            counts = quantise(y, sensor.lsb_per_dps, sensor.range_dps)
            y = counts / sensor.lsb_per_dps
    with whole_file(out) as file:
        if out.suffix.lower() == ".csv":
            _write_csv(file, y, x, orders, rate_hz)
            return
        data: dict[str, ArrayLike] = {"fs_hz": rate_hz, "true_state_dps": x}
        if orders is not None:
            data["true_alpha"] = orders
        if counts is None:
            data["gyro_dps"] = y
        else:
            data["gyro_raw"], data["lsb_per_dps"] = counts, float(sensor.lsb_per_dps or 0.0)
        np.savez_compressed(file, allow_pickle=False, **data)


def _write_csv(file: BinaryIO, y: Array, x: Array, orders: Array | None, rate_hz: float) -> None:
    names = AXES[: y.shape[1]]
    header = ["time_s", *[f"{a}_dps" for a in names], *[f"true_state_{a}_dps" for a in names]]
    columns = [y, x]
    if orders is not None:
        header.append("true_alpha")
        columns.append(orders[:, np.newaxis])
    with text_of(file) as text:
        rows = csv.writer(text)
        rows.writerow(header)
        for k, row in enumerate(np.hstack(columns)):
            rows.writerow([repr(k / rate_hz), *row.tolist()])
