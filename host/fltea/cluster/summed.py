"""Identifies the noise of a recording that was cut into pieces.

Spectra can be added, so workers send only sums.

A cut counts as a gap: nothing is computed across a cut, and processes slower than a piece are not detected.
The FLTEA filter needs all samples in order, so its results are missing.
"""

import time
from collections.abc import Sequence

import msgspec
import numpy as np

from fltea.cluster.cut import Cut
from fltea.cluster.listing import File
from fltea.cluster.pieces import write_piece
from fltea.cluster.rows import (
    COEFFICIENTS,
    VALUES,
    Key,
    Row,
    data_check_kinds,
    failed,
    of_recording,
    with_ends,
)
from fltea.cluster.whole import Ask
from fltea.identification.gaps import bridged
from fltea.identification.load import Series, load
from fltea.identification.sums import (
    AT_ONCE,
    examined_sums,
    lines_together,
    octaves_of_stretches,
    one_a_depth,
    parts_of,
)
from fltea.records.errors import FlteaError, NoNumbers, UsageError
from fltea.records.temporary import work_folder
from fltea.spectrum.allan_curve import live_allan
from fltea.spectrum.noise_figures import NoiseFigures, noise_figures
from fltea.spectrum.octaves import Octaves, Parts
from fltea.spectrum.spectral import Spectral
from fltea.spectrum.verdict import decide

SAME_RATE = 5e-3
"""Two sampling rates count as equal if their relative difference is at most this. The clocks of two devices
differ by less.
"""


class AxisSums(msgspec.Struct, frozen=True):
    """Sums over the samples of one sensor axis in one piece of a file.

    `octaves`: running spectrum by octaves, as bytes (`Octaves.save`). `lines`: the piece's spectra, in which
    spectral peaks are searched for.
    """

    unit: str
    lsb: float | None
    samples: int
    longest: int
    mean: float
    squares: float
    """Sum of the squared deviations from the mean."""
    octaves: bytes
    lines: list[Parts]


class PieceSums(msgspec.Struct, frozen=True):
    """Sums over one piece of a file.

    `about`: facts about the recording for the rows of the table. `empty`: why the piece has no samples; "" if
    it has samples.
    """

    rate_hz: float
    about: dict[str, object]
    data_checks: list[str]
    axes: dict[str, AxisSums]
    seconds: float
    empty: str = ""

    @property
    def samples(self) -> int:
        """Number of samples of the axis with the most samples."""
        return max((axis.samples for axis in self.axes.values()), default=0)

    def goes_with(self, other: "PieceSums") -> bool:
        """Return whether rate, axes, units and scales are equal, so that the sums can be added."""
        ours, theirs = (
            [(name, axis.unit, axis.lsb) for name, axis in one.axes.items()] for one in (self, other)
        )
        return abs(self.rate_hz / other.rate_hz - 1) < SAME_RATE and ours == theirs


def sum_piece(file: File, cut: Cut, ask: Ask) -> PieceSums | str:
    """Return the sums over a piece, or a text that says why there are none.

    Raises:
        OSError: the piece is not readable now; its file system may raise other errors.
    """
    begin = time.monotonic()
    with work_folder() as folder:
        path = write_piece(file, cut, folder)
        try:
            found = load(ask.request(path), folder)
            axes = {name: _sums(series) for name, series in found.axes.items()}
        except (UsageError, ValueError) as error:
            reason = str(error).replace(str(path), f"{file.url} from byte {cut.begin}")
            if not isinstance(error, NoNumbers):
                return reason
            seconds = time.monotonic() - begin
            return PieceSums(0.0, {"lost": error.rows}, ["missing_numbers"], {}, seconds, reason)
    about, data_checks = of_recording(found), data_check_kinds(found.data_checks)
    return PieceSums(found.hello.rate_hz, about, data_checks, axes, time.monotonic() - begin)


def _sums(series: Series) -> AxisSums:
    stretches = bridged(series.y, series.gaps)
    sums = octaves_of_stretches(stretches)
    mean = float(np.mean(series.y))
    squares = sum(
        float(np.sum((series.y[at : at + AT_ONCE] - mean) ** 2)) for at in range(0, len(series.y), AT_ONCE)
    )
    return AxisSums(
        series.unit,
        series.lsb,
        len(series.y),
        max(len(one.y) for one in stretches),
        mean,
        squares,
        sums.save(),
        one_a_depth(parts_of(stretches)),
    )


def fit_pieces(file: File, ask: Ask, pieces: Sequence[PieceSums]) -> list[Row]:
    """Return a row for each axis of a file that was read in pieces, or one row with an error.

    Only pieces with the rate and the axes of the largest piece are used. A piece without valid numbers counts
    as a gap.
    """
    begin = time.monotonic()
    key = Key(file, ask.digest())
    largest = max(pieces, key=lambda one: one.samples)
    if largest.empty:
        return failed(key, largest.empty, again=False, parts=len(pieces))
    used = [one for one in pieces if one.goes_with(largest)]
    counted = [*used, *(one for one in pieces if one.empty)]
    samples = sum(one.samples for one in used)
    rate_hz = sum(one.rate_hz * one.samples for one in used) / max(samples, 1)
    about = {
        **largest.about,
        "lost": sum(int(str(one.about["lost"])) for one in counted),
        "parts": len(used),
        "rate_hz": rate_hz,
        "data_checks": sorted({data_check for one in counted for data_check in one.data_checks}),
    }
    rows = []
    for name in largest.axes:
        try:
            values = _fitted([one.axes[name] for one in used], 1 / rate_hz, ask)
            rows.append(key.row(axis=name, **about, **values))
        except (FlteaError, ValueError) as error:
            rows.append(key.row(axis=name, error=str(error), **about))
    seconds = time.monotonic() - begin + sum(one.seconds for one in pieces)
    for row in rows:
        row.seconds = round(seconds, 3)
    return rows or failed(key, "it has no axes", again=False, parts=len(used))


def _fitted(pieces: Sequence[AxisSums], h: float, ask: Ask) -> dict[str, object]:
    """Return the values of the row for an axis, from the added sums of its pieces.

    Raises:
        ValueError: the axis is constant, or too short.
    """
    sums, *later = (Octaves.restore(1, 0.0, piece.octaves) for piece in pieces)
    for one in later:
        sums.merge(one)
    if sums.counts(0).constant:
        raise ValueError("y is constant: there is no noise in it")
    samples = sum(piece.samples for piece in pieces)
    longest = max(piece.longest for piece in pieces)
    options = ask.settings.options
    lines, drift = lines_together([one for piece in pieces for one in piece.lines], h, longest)
    seen = examined_sums(lines, drift, sums, samples, h, options.from_hz, options.notch_hz)
    verdict = decide(seen.evidence)
    found = noise_figures(seen.evidence, verdict)
    mean = sum(piece.mean * piece.samples for piece in pieces) / samples
    squares = sum(piece.squares + piece.samples * (piece.mean - mean) ** 2 for piece in pieces)
    return {
        "unit": pieces[0].unit,
        "lsb": pieces[0].lsb,
        "samples": samples,
        "duration_s": samples * h,
        "longest_s": longest * h,
        "kind": verdict.kind,
        "text": verdict.text,
        "p_white": seen.evidence.p_clean,
        "mean": mean,
        "std": (squares / max(samples - 1, 1)) ** 0.5,
        "values": with_ends(verdict.order, VALUES) | _allan_values(sums, seen, found, pieces[0].unit),
    }


def _allan_values(sums: Octaves, seen: Spectral, noise: NoiseFigures, unit: str) -> dict[str, float | None]:
    points, f = sums.allan(0), seen.evidence.candidates
    try:
        found = live_allan(points.factors, points.avar, points.terms, points.samples, f.h, unit)
    except ValueError:
        return {}
    return with_ends(found.with_model(f, noise.model, noise.level, unit), COEFFICIENTS)
