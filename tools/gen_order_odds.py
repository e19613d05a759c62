"""Calibrates the odds that a noise is of fractional order (`spectrum.order_odds`).

The program writes order_odds_constants.py into the folder of the module `order_odds`.

A population is a family of random noises, such as noises with an order (`tools.validation.odds.populations`).
The program draws noises of each population at several lengths, runs the model search on each noise, and fits
a logistic regression. At each length, every population has a fixed total weight in this regression; the
noises that were drawn share the weight. This takes some ten minutes on two cores. The results for the drawn
noises are stored, so that a second run only makes the fit.

Usage: python -m tools.gen_order_odds [--series 600] [--kept build/order_odds.ndjson] [--print]
"""

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from fltea.identification.workers import open_local
from fltea.spectrum.order_odds import FARTHEST
from scipy.optimize import minimize

from tools.generated import rendered, update
from tools.validation.odds.counts import count
from tools.validation.odds.populations import POPULATIONS
from tools.validation.runner import Row, Task, run

HERE = Path(__file__).resolve().parents[1] / "host/fltea/spectrum"
SEED = 45
"""Seed of the noises for the calibration; the validation draws with other seeds."""
LENGTHS = {3_000: 1.0, 20_000: 1.0, 60_000: 1.0, 200_000: 0.4, 1_000_000: 0.1}
"""For each length of a record [samples]: number of noises of this length, divided by the number of noises of
the shortest length.
"""
AT_ONCE = 20
RIDGE = 1e-5
"""Ridge penalty: the regression also minimises this times the sum of the squared coefficients. Without it,
coefficients could become infinite.
"""


def tasks(series: int) -> list[Task]:
    """Return the tasks that draw noises: for each length, those of each population (family of noises)."""
    return [
        Task(f"{population}, {samples}", count, (population, samples, first, AT_ONCE, SEED), samples)
        for samples, share in LENGTHS.items()
        for population in POPULATIONS
        for first in range(0, round(series * share), AT_ONCE)
    ]


def fitted(rows: list[Row]) -> tuple[tuple[float, float], list[list[float]]]:
    """Return the range of validity, then the fitted coefficients of the log odds.

    The range is that of the number of ordinates (frequencies) in a noise's periodogram: the smallest and the
    largest number among the drawn noises.
    """
    # Leave out noises that are so nearly white that the model search gives no odds for them.
    rows = [row for row in rows if row["odds"] is not None]
    drawn = Counter((row["population"], row["samples"]) for row in rows)
    weight = np.array([POPULATIONS[r["population"]][1] / drawn[r["population"], r["samples"]] for r in rows])
    ordinates = np.array([row["ordinates"] for row in rows])
    lowest = float(ordinates.min())
    decades = np.log10(ordinates / lowest)
    figures = [np.ones(len(rows))]
    for name in ("lead", "over_rich"):
        figures.append(np.clip([row[name] for row in rows], -FARTHEST, FARTHEST) / FARTHEST)
    columns = np.column_stack([column for one in figures for column in (one, one * decades)])
    sign = np.where([row["population"] == "order" for row in rows], 1.0, -1.0)

    def minus_log(b: np.ndarray) -> float:
        return float((weight * np.logaddexp(0, -sign * (columns @ b))).sum() + RIDGE * b @ b)

    found = minimize(minus_log, np.zeros(columns.shape[1])).x
    return (lowest, float(ordinates.max())), found.reshape(-1, 2).tolist()


def main() -> int:
    """Draw, fit and write the constants; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--series", type=int, default=600, help="noises of each population, of 3,000 samples")
    parser.add_argument("--kept", type=Path, default=Path("build/order_odds.ndjson"), help="what was drawn")
    parser.add_argument("--print", action="store_true", help="write nothing; print the coefficients")
    arguments = parser.parse_args()
    arguments.kept.parent.mkdir(parents=True, exist_ok=True)
    workers = open_local(None)
    try:
        rows = run(tasks(arguments.series), workers, arguments.kept, resume=arguments.kept.exists())
    finally:
        workers.close()
    ordinates, coefficients = fitted(rows)
    text = rendered(
        "order_odds_constants.py", series=len(rows), ordinates=ordinates, coefficients=coefficients
    )
    if arguments.print:
        print(text)
        return 0
    return update(HERE, {"order_odds_constants.py": text}, check=False, source="tools/gen_order_odds.py")


if __name__ == "__main__":
    sys.exit(main())
