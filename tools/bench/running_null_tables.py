"""What the running test of whiteness is worth: false alarms, ever-rejections of white noise, power, cost.

Usage: python -m tools.bench.running_null_tables [--series N] [--hours H] [--recordings DIR]

False alarms from N series (1,000) of each length, power from N/5 and N/20; "ever" from N/4 that are looked at
with every chunk for H hours (1) at 100 Hz. Takes some ten minutes of processor time.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from fltea.estimator.running_null import CHUNK, EFFECTIVE, RunningNull, p_value
from fltea.records.null_p import LEVEL
from numpy.typing import NDArray

from tools.bench.identify_tables import FAMILIES, LENGTHS, STRENGTHS, WHITE, H, fractional_state, in_white

Array = NDArray[np.float64]

LEVELS = (0.05, 0.01, LEVEL)
MARKS_S = (30, 60, 600, 3_600, 6 * 3_600, 24 * 3_600)


def p_values(test: RunningNull) -> Array:
    """Of every series, not rounded; 1 where nothing is known."""
    effective = EFFECTIVE * test.depth
    return np.array([p_value(one, effective) if effective else 1.0 for one in test.largest()])


def of_series(y: Array) -> Array:
    """p-values of series of some length, (samples, series)."""
    test = RunningNull(y.shape[1])
    test.add_rows(y[: len(y) // CHUNK * CHUNK])
    return p_values(test)


def shares(p: Array) -> str:
    """How many are below each level."""
    return "  ".join(f"{np.mean(p < level):7.2%} at {level:g}" for level in LEVELS)


def ever(series: int, hours: float, rng: np.random.Generator) -> None:
    """How many runs of white noise have been rejected by some time."""
    test, least, marks = RunningNull(series), np.ones(series), list(MARKS_S)
    for k in range(1, int(hours * 3600 / H) // CHUNK + 1):
        test.add_rows(rng.standard_normal((CHUNK, series)))
        least = np.minimum(least, p_values(test))
        if marks and (k + 1) * CHUNK * H > marks[0]:
            print(f"  by {marks.pop(0):>6} s {shares(least)}", flush=True)


def cost() -> float:
    """Processor time of a sample of three axes [µs]."""
    rows = np.random.default_rng(1).standard_normal((60_000, 3))
    test, start = RunningNull(3), time.process_time()
    test.add_rows(rows)
    return (time.process_time() - start) / len(rows) * 1e6


def main() -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--series", type=int, default=1_000)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--recordings", type=Path, help="folder of .npz recordings of sensors at rest")
    arguments = parser.parse_args()
    rng, series = np.random.default_rng(20260701), arguments.series
    print(f"{cost():.1f} µs a sample of three axes")
    for length, n in LENGTHS.items():
        few = max(2, series // 5 if n < 10_000 else series // 20)
        print(f"\nwhite noise of {length}, rejected")
        for name, make in WHITE.items():
            groups = [np.array([make(n, rng) for _ in range(100)]).T for _ in range(max(1, series // 100))]
            print(f"  {name:<34} {shares(np.concatenate([of_series(y) for y in groups]))}", flush=True)
        print(f"\nother noise of {length}, rejected")
        others = {name: in_white(fractional_state(a, f), share) for name, (a, f, share) in STRENGTHS.items()}
        for name, make in (others | FAMILIES).items():
            p = of_series(np.array([make(n, rng) for _ in range(few)]).T)
            print(f"  {name:<34} {shares(p)}", flush=True)
    print("\nwhite noise that is looked at all the time, ever rejected")
    ever(max(2, series // 4), arguments.hours, rng)
    for file in sorted(arguments.recordings.glob("*.npz")) if arguments.recordings else ():
        with np.load(file) as d:
            print(file.stem, of_series(d["gyro_raw"] / float(d["lsb_per_dps"])))
    return 0


if __name__ == "__main__":
    sys.exit(main())
