"""Section 7 of Macias & Sierociuk 2023: a resting gyroscope, or white noise where there is no recording.

White noise has the paper's R as its variance, and the filters get that R. A recording gives its first 3,000
samples, mean removed, as the printed algorithm diverges on an offset; R is then the variance of these
samples, not the paper's, for R belongs to the sensor and the algorithm diverges on one that is far too small.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fltea.lab.reproduce import paper
from fltea.lab.reproduce.scenarios import GYROSCOPE_FILTERS, Data, Scenario
from fltea.noise.weights import Array
from fltea.recording.csv_file import read_csv
from fltea.recording.kind import KINDS
from fltea.recording.ndjson import read_ndjson
from fltea.recording.npz_file import read_npz
from fltea.records.errors import UsageError
from fltea.records.records import Hello, Sample

Make = Callable[[Sequence[int]], Data]


@dataclass(frozen=True)
class RecordingFile:
    """A file that `replay:` reads, and what a CSV file does not say itself (host/docs/guide/sources.md)."""

    path: Path
    columns: list[str] | None = None
    units: str | None = None
    rate_hz: float | None = None


def white_noise() -> dict[str, Scenario]:
    """Axis name to its experiment on white noise of the paper's R; each seed gives three independent axes."""
    return {axis: _white_axis(number, axis, R) for number, (axis, R) in enumerate(paper.GYRO_R.items())}


def _white_axis(number: int, axis: str, R: float) -> Scenario:
    def make(seeds: Sequence[int]) -> Data:
        n = paper.GYRO_SAMPLES
        noise = [np.random.default_rng((seed, number)).normal(0, np.sqrt(R), n) for seed in seeds]
        return Data(np.column_stack(noise))

    source = "white noise with the paper's R as its variance, in place of a recording"
    return _scenario(axis, source, R, make, paper.GYRO_H, single=False)


def recorded(recording: RecordingFile) -> dict[str, Scenario]:
    """Axis name to its experiment on a recording as `replay:` reads it (.npz, .csv, .ndjson).

    Raises:
        UsageError: a file that cannot be read, is shorter than the paper's run, or stands still.
    """
    path = recording.path
    gyro_dps, rate_hz = _read(recording)
    n = paper.GYRO_SAMPLES
    if len(gyro_dps) < n:
        raise UsageError(f"{path}: has {len(gyro_dps):,} samples; the paper's runs take {n:,}.")
    first = gyro_dps[:n] - gyro_dps[:n].mean(axis=0)
    scenarios = {}
    for axis, values in zip(paper.GYRO_R, first.T, strict=False):
        R = float(values.var())
        if R == 0:
            raise UsageError(f"{path}: the {axis} axis never changes in the first {n:,} samples.")
        source = f"recording {path.name}, {rate_hz:g} Hz, R = its variance"
        make = _always(Data(values[:, np.newaxis]))
        scenarios[axis] = _scenario(axis, source, R, make, 1 / rate_hz, single=True)
    return scenarios


def _always(data: Data) -> Make:
    return lambda seeds: data


def _scenario(axis: str, source: str, R: float, make: Make, h: float, *, single: bool) -> Scenario:
    return Scenario(
        title=f"Gyroscope, {axis} axis",
        source=source,
        lengths=paper.GYRO_LENGTHS,
        filters=replace(GYROSCOPE_FILTERS, h=h, R=R),
        R=R,
        samples=paper.GYRO_SAMPLES,
        make=make,
        unit="deg/s",
        single=single,
    )


def _read(recording: RecordingFile) -> tuple[Array, float]:
    """Samples (n, axes) in deg/s and their rate in Hz; of several epochs the first."""
    path, suffix = recording.path, recording.path.suffix.lower()
    if not path.is_file():
        raise UsageError(f"--recording {path}: there is no such file.")
    is_csv = KINDS.get(suffix) == "csv"
    if not is_csv and recording != RecordingFile(path):
        raise UsageError(f"{path}: --columns, --units and --rate are for CSV files; this one names its own.")
    if is_csv or suffix == ".npz":
        how = recording.columns, recording.units, recording.rate_hz
        read = read_csv(path, *how) if is_csv else read_npz(path)
        return read.gyro / (read.lsb_per_dps or 1.0), read.rate_hz
    if suffix in (".ndjson", ".jsonl"):
        records, _ = read_ndjson(path)
        samples = [record for record in records if isinstance(record, Sample)]
        rows = [sample.gyro_dps for sample in samples if sample.epoch == samples[0].epoch]
        return np.array(rows), next(record.rate_hz for record in records if isinstance(record, Hello))
    raise UsageError(f"--recording {path}: give a file that ends in .npz, .csv or .ndjson.")
