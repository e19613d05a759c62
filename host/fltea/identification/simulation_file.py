"""Write simulated noise and its true state to a file that the source `replay:` can read."""

import contextlib
import csv
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from fltea.noise.simulation import FractionalNoise, quantise
from fltea.records.arrays import Array
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.records.whole_file import text_of, whole_file
from fltea.sources.synthetic import NoiseSettings


def write_simulation(out: Path, settings: NoiseSettings, alpha_end: float, axes: int) -> None:
    """Write simulated noise whose order may change.

    The order α changes linearly from that of `settings` at the first sample to `alpha_end` at the last one.

    Samples are in counts unless `settings.lsb_per_dps` is 0. The file is written completely or not at all.
    `axes`: number of axes.

    Raises:
        UsageError: the parameters are impossible, the noise diverges, or the name ends neither in .csv nor
            .npz.
        FlteaError: the file cannot be written.
    """
    s = settings
    _check(out, s)
    if not 1 <= axes <= len(AXES) or s.rate_hz <= 0:
        raise UsageError("simulate needs --axes 1 to 3 and --rate > 0.")
    for name, value in (("--alpha", s.alpha), ("--alpha-end", alpha_end)):
        if not math.isfinite(value):
            raise UsageError(f"simulate: {name} has to be a finite number, not {value}.")
    with _impossible():
        orders = np.linspace(s.alpha, alpha_end, s.n)

    def draw(axis: int) -> tuple[Array, Array]:
        rng = np.random.default_rng((s.seed, axis))
        return FractionalNoise(orders, s.f, s.Q, s.R, 1.0 / s.rate_hz, s.window, rng).samples(s.n)

    _simulate(out, draw, axes, orders, s)


def write_model_simulation(out: Path, model: Path, settings: NoiseSettings) -> None:
    """Write simulated noise of the axes in `model`, a file of `fltea identify --export-model`.

    From `settings` come only the number of samples, the seed, the offset, and the range and rounding of the
    sensor. The sampling rate and the noise are those of the model. The file also holds the true state, which
    is the sum of all noise that is not white. Unlike the file of `write_simulation`, it does not hold the
    order.

    Raises:
        UsageError: the model cannot be read, the settings are impossible, or the name ends neither in .csv
            nor .npz.
        FlteaError: the file cannot be written.
    """
    from fltea.identification.model_file import read_models
    from fltea.identification.noise_model import draw

    _check(out, settings)
    models = read_models(model)
    if not models.axes:
        raise UsageError(f"{model}: has no gyroscope axis, and only gyroscope axes are simulated.")

    def drawn(axis: int) -> tuple[Array, Array]:
        rng = np.random.default_rng((settings.seed, axis))
        return draw(models.axes[AXES[axis]], models.h_s, settings.n, rng)

    _simulate(out, drawn, len(models.axes), None, replace(settings, rate_hz=models.rate_hz))


@contextlib.contextmanager
def _impossible() -> Iterator[None]:
    """Turn errors about impossible noise or lack of memory into a UsageError."""
    try:
        with np.errstate(all="ignore"):  # simulated values that overflow become NaN, which is reported later
            yield
    except (ValueError, ArithmeticError, MemoryError) as error:
        raise UsageError(f"simulate: {error}.") from error


def _check(out: Path, settings: NoiseSettings) -> None:
    if out.suffix.lower() not in (".csv", ".npz"):
        raise UsageError(f"{out}: give a name that ends in .csv or .npz.")
    if settings.n < 1:
        raise UsageError("simulate needs --samples ≥ 1.")
    if not math.isfinite(settings.offset_dps):
        raise UsageError(f"simulate: --offset has to be a finite number, not {settings.offset_dps}.")


def _simulate(
    out: Path,
    draw: Callable[[int], tuple[Array, Array]],
    axes: int,
    orders: Array | None,
    settings: NoiseSettings,
) -> None:
    """Draw samples and true states of each axis, and write them to `out`.

    The order α at each sample is written, too, if it is known.
    """
    with _impossible():
        y, x = (np.stack(one, axis=1) for one in zip(*map(draw, range(axes)), strict=True))
        y, counts = y + settings.offset_dps, None
        if settings.lsb_per_dps:
            counts = quantise(y, settings.lsb_per_dps, settings.range_dps)
            y = counts / settings.lsb_per_dps
    with whole_file(out) as file:
        if out.suffix.lower() == ".csv":
            _write_csv(file, y, x, orders, settings.rate_hz)
            return
        data: dict[str, ArrayLike] = {"fs_hz": settings.rate_hz, "true_state_dps": x}
        if orders is not None:
            data["true_alpha"] = orders
        if counts is None:
            data["gyro_dps"] = y
        else:
            data["gyro_raw"], data["lsb_per_dps"] = counts, settings.lsb_per_dps
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
