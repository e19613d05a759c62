"""Compare Allan deviations that `fltea identify` computes for models with simulations of these models.

One record of each noise of the gallery is identified. Two quantities are computed from the spectrum of the
fitted model: the Allan deviation, and its degrees of freedom, which say how well a record of this length
determines it. Then many records are simulated with the model, and both quantities are estimated from them.
"""

import itertools
import math
import zlib

import numpy as np
from fltea.identification.about_levels import analyse_series
from fltea.identification.allan import averaging_factors, differences, overlapping
from fltea.identification.axis import IdentifyOptions
from fltea.identification.load import GYRO_UNIT, Series
from fltea.identification.noise_model import check_possible, draws, modelled
from fltea.identification.reproduction import expected
from fltea.spectrum.wording import names

from tools.validation.gallery.noises import NOISES
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table

SEEDS = QUICK_SEEDS = 200
"""Number of records drawn from each model."""
COLUMNS = {
    "lines": "d",
    "mean_off": ".1f",
    "degrees_ratio": ".3f",
    "degrees_least": ".2f",
    "degrees_most": ".2f",
}
RATE_HZ = 100.0
DURATION_S, QUICK_S = 600.0, 30.0


def tasks(options: Options) -> list[Task]:
    """Return a task for each noise."""
    duration_s = QUICK_S if options.quick else DURATION_S
    return [Task(name, compare, (name, duration_s, options.seeds)) for name in NOISES if options.wanted(name)]


def compare(name: str, duration_s: float, simulations: int) -> list[Row]:
    """Return one row for a noise, or no row if no model can be fitted to the noise.

    The row has the largest difference between the computed and the simulated Allan variance, in standard
    errors, and the ratio of the computed to the simulated degrees of freedom.
    """
    n, h = round(duration_s * RATE_HZ), 1 / RATE_HZ
    y = NOISES[name].draw(n, RATE_HZ, np.random.default_rng([zlib.crc32(name.encode()), n]))
    try:
        analysis, *_ = analyse_series(Series(y, GYRO_UNIT, None), h, IdentifyOptions(), None)
        peaks = analysis.summed.seen.evidence.peaks
        model = modelled(analysis.figures.model, peaks, float(analysis.y.std(ddof=1)), h)
        check_possible(model, h)
    except ValueError:
        return []
    factors = averaging_factors(n)
    terms = differences(factors, [n])
    deviation, degrees = expected(model, h, factors.astype(np.float64), terms)
    drawn = itertools.islice(draws(model, h, n, np.random.default_rng(1)), simulations)
    squares = np.array([overlapping([one], factors) for one, _ in drawn]) ** 2
    mean, std = squares.mean(axis=0), squares.std(axis=0, ddof=1)
    off = (mean - deviation**2) / (std / math.sqrt(simulations) + 1e-3 * mean)
    ratio = np.log(degrees * (std / mean) ** 2 / 2)
    return [
        {
            "noise": name,
            "model": names(analysis.figures.model.kinds),
            "lines": len(model.resonances),
            "points": len(factors),
            "mean_off": float(np.abs(off).max()),
            "degrees_ratio": float(np.exp(ratio.mean())),
            "degrees_least": float(np.exp(ratio.min())),
            "degrees_most": float(np.exp(ratio.max())),
        }
    ]


def tables(rows: list[Row]) -> list[Table | str]:
    """Return a table with one row for each model, and a summary over all models."""
    cells = [
        [row["noise"], row["model"], *(format(row[key], form) for key, form in COLUMNS.items())]
        for row in rows
    ]
    degrees = "degrees of freedom, computed / drawn"
    headings = ("noise", "its model", "lines", "mean off by, σ", degrees, "at a time, least", "most")
    ratios = np.array([row["degrees_ratio"] for row in rows])
    spread = f"(median; {ratios.min():.2f} to {ratios.max():.2f})"
    off, points = max(row["mean_off"] for row in rows), sum(row["points"] for row in rows)
    return [
        Table("Allan deviation of models, computed and drawn", headings, cells, brief=False),
        f"Of {len(rows)} models the degrees of freedom are {np.median(ratios):.3f} times those of records "
        f"drawn {spread}, which are known to a tenth; of {points} points none has a mean that is "
        f"off by more than {off:.1f} standard deviations.",
    ]
