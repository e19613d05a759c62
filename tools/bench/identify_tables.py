"""How far `fltea identify` can be believed: false alarms, power, false claims, coverage, verdicts.

Usage: make bench ARGS="--identify [--seeds N] [--json]", or with the recordings of a folder
python -m tools.bench.identify_tables [--quick] [--seeds N] [--json] [--recordings DIR]

Simulated series at 100 Hz, 3,000 samples (30 s) and 60,000 (10 min): N of them (1,000) for each false alarm,
N/5 for false peaks and the power at 30 s, N/10 for power at 10 min and verdicts, N/20 for fractional noise
and coverage. `--quick` takes N = 20: half a minute.
"""

import argparse
import itertools
import json
import multiprocessing
import os
import sys
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from fltea.identification.sums import examined, lines_of, octaves_of
from fltea.noise.weights import weights
from fltea.spectrum.likelihood_ratio import null_fits, p_value
from fltea.spectrum.lines import find_peaks
from fltea.spectrum.periodogram import binned, periodogram
from fltea.spectrum.profile import fractional_fit
from fltea.spectrum.rivals import fit_all
from fltea.spectrum.verdict import decide
from numpy.typing import NDArray
from tools.validation.gallery.recursions import inverse_series

Array = NDArray[np.float64]
Make = Callable[[int, np.random.Generator], Array]

H = 0.01
LENGTHS = {"30 s": 3_000, "10 min": 60_000}
BATCH = 25


def filtered(transfer: Callable[[Array], Array], n: int, rng: np.random.Generator) -> Array:
    """Stationary noise of the transfer function, λ to complex, by a circle four times as long."""
    m = 4 * n
    lam = 2 * np.pi * np.arange(m // 2 + 1) / m
    lam[0] = lam[1]
    return np.fft.irfft(np.fft.rfft(rng.standard_normal(m)) * transfer(lam), m)[:n]


def fractional_state(alpha: float, f: float) -> Make:
    """State of the recursion itself, unit innovations, from its impulse response with unlimited memory."""

    def make(n: int, rng: np.random.Generator) -> Array:
        warm = 4 * n
        noise = np.fft.rfft(rng.standard_normal(warm), 2 * warm)
        x: Array = np.fft.irfft(noise * response(alpha, f, warm), 2 * warm)
        return x[warm - n : warm]

    return make


@lru_cache(maxsize=4)
def response(alpha: float, f: float, n: int) -> NDArray[np.complex128]:
    """Spectrum of the first n of the state's impulse response, padded to twice as many."""
    c = weights(alpha, n)[:n].copy()
    c[1] -= H**alpha * f
    return np.asarray(np.fft.rfft(inverse_series(c), 2 * n))


def in_noise(alpha: float, f: float, noise: float) -> Make:
    """A fractional state of unit innovations in white noise of variance `noise`."""
    make = fractional_state(alpha, f)
    return lambda n, rng: make(n, rng) + np.sqrt(noise) * rng.standard_normal(n)


def ar(*phi: float) -> Make:
    """AR process of unit variance."""

    def make(n: int, rng: np.random.Generator) -> Array:
        x = filtered(
            lambda lam: 1 / (1 - sum(p * np.exp(-1j * lam * (i + 1)) for i, p in enumerate(phi))), n, rng
        )
        found: Array = x / x.std()
        return found

    return make


def in_white(part: Make, share: float) -> Make:
    """The part with so much of the power, in white noise of the rest."""

    def make(n: int, rng: np.random.Generator) -> Array:
        x = part(n, rng)
        found: Array = np.sqrt(share) * x / x.std() + np.sqrt(1 - share) * rng.standard_normal(n)
        return found

    return make


def random_walk(n: int, rng: np.random.Generator) -> Array:
    """White noise on a random walk that reaches its size in about 30 s."""
    found: Array = rng.standard_normal(n) + np.cumsum(rng.standard_normal(n)) / np.sqrt(3000)
    return found


def ramp(n: int, rng: np.random.Generator) -> Array:
    """White noise on a ramp of three of its deviations over the record."""
    return rng.standard_normal(n) + np.linspace(0, 3, n)


def line(n: int, rng: np.random.Generator) -> Array:
    """White noise and a tenth of the power in one line."""
    t = np.arange(n) * H
    found: Array = rng.standard_normal(n) + 0.47 * np.sin(2 * np.pi * 13.37 * t + rng.uniform(0, 2 * np.pi))
    return found


def low_pass(n: int, rng: np.random.Generator) -> Array:
    """The sensor's own filter: white noise through two poles at 20 Hz, with a tenth of the power white."""
    return in_white(ar(0.57, -0.08), 0.9)(n, rng)


def moving_average(n: int, rng: np.random.Generator) -> Array:
    """A filter without poles: the mean of four samples."""
    x = np.convolve(rng.standard_normal(n + 3), np.ones(4) / 2, mode="valid")
    return x + 0.3 * rng.standard_normal(n)


WHITE: dict[str, Make] = {
    "Gaussian": lambda n, rng: rng.standard_normal(n),
    "one LSB per σ": lambda n, rng: np.rint(rng.standard_normal(n)),
    "t4 tails": lambda n, rng: rng.standard_t(4, n),
}
FAMILIES: dict[str, Make] = {
    "white": WHITE["Gaussian"],
    "random walk": random_walk,
    "ramp": ramp,
    "line": line,
    "resonance": in_white(ar(2 * 0.97 * np.cos(1.97), -(0.97**2)), 0.2),
    "low-pass": low_pass,
    "moving average": moving_average,
    "AR(.5)": in_white(ar(0.5), 0.5),
    "AR(.99)": in_white(ar(0.99), 0.3),
    "AR(.99) + AR(.5)": lambda n, rng: ar(0.99)(n, rng) + ar(0.5)(n, rng) + 0.7 * rng.standard_normal(n),
}
STRENGTHS: dict[str, tuple[float, float, float]] = {
    f"α {alpha}, f {f}, {share:.0%} of the power": (alpha, f, share)
    for alpha, f in ((0.1, 0.0), (0.3, 0.0), (0.3, -1.8), (0.6, -0.3), (0.6, -3.0))
    for share in (0.1, 0.3, 1.0)
}
TRUTHS = ((0.4, -1.0, 0.0), (0.6, -3.0, 0.5), (0.8, -1.0, 0.2), (0.8, -10.0, 1.0))
"""α, f, R over s2, for the coverage of intervals"""


def rejections(make: Make, n: int, series: int, rng: np.random.Generator) -> dict[str, float]:
    """Share of series that the null test rejects at 5 % and 1 %."""
    found = []
    for _ in range(series):
        data = binned(lines_of(octaves_of(make(n, rng)), H))
        found.append(p_value(float(null_fits(data).likelihood_ratio[0]), data.ordinates))
    return {"5 %": float(np.mean(np.array(found) < 0.05)), "1 %": float(np.mean(np.array(found) < 0.01))}


def verdicts(make: Make, n: int, series: int, rng: np.random.Generator) -> dict[str, int]:
    """How often each verdict is given."""
    return dict(Counter(decide(examined(make(n, rng), H).evidence).kind for _ in range(series)))


def coverage(
    truth: tuple[float, float, float], n: int, series: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Share of the intervals that hold the true value, of those that are defined, and the median estimate."""
    alpha, f, noise = truth
    g = H**alpha * f
    true = {"F": g + alpha, "alpha": alpha, "g": g, "f": f, "s2": 1.0, "R": noise}
    hits: dict[str, list[bool]] = {name: [] for name in true}
    values: dict[str, list[float]] = {name: [] for name in true}
    make = in_noise(alpha, f, noise)
    for _ in range(series):
        fits = fit_all(lines_of(octaves_of(make(n, rng)), H))
        fit = fractional_fit(fits.data, fits.full, H)
        for name, value in true.items():
            p = getattr(fit, name)
            values[name].append(p.value)
            if p.low is not None:
                hits[name].append(bool(p.low <= value <= p.high))
    return {
        name: {
            "true": true[name],
            "median": float(np.median(values[name])),
            "spread": float(np.std(values[name])),
            "covered": float(np.mean(hits[name])) if hits[name] else None,
            "defined": len(hits[name]) / series,
        }
        for name in true
    }


def recordings(folder: Path) -> dict[str, Any]:
    """Verdict, p-value and fit of every axis of the recordings in a folder."""
    result = {}
    for file in sorted(folder.glob("*.npz")):
        with np.load(file) as d:
            y, h = d["gyro_raw"] / float(d["lsb_per_dps"]), 1 / float(d["fs_hz"])
        for axis, name in enumerate("xyz"):
            seen = examined(y[:, axis], h)
            e = seen.evidence
            verdict = decide(e)
            result[f"{file.stem} {name}"] = {
                "p": e.p_all,
                "p_without_peaks": e.p_without_peaks,
                "p_clean": e.p_clean,
                "verdict": verdict.kind,
                "text": verdict.text,
                "best": e.contest.best,
            }
    return result


def false_peaks(make: Make, n: int, series: int, rng: np.random.Generator) -> float:
    """Share of series in which a line or resonance is found."""
    return float(np.mean([bool(find_peaks(periodogram(make(n, rng), H))) for _ in range(series)]))


def power(strength: tuple[float, float, float], n: int, series: int, rng: np.random.Generator) -> float:
    """Share of series that the null test rejects at 5 %: α, f, share of the power in the state."""
    alpha, f, share = strength
    return rejections(in_white(fractional_state(alpha, f), share), n, series, rng)["5 %"]


def fractional_verdicts(
    truth: tuple[float, float, float], n: int, series: int, rng: np.random.Generator
) -> dict[str, int]:
    """How often each verdict is given on noise of fractional order."""
    return verdicts(in_noise(*truth), n, series, rng)


NAMED_TRUTHS = {f"α {alpha}, f {f}, R/s2 {noise}": (alpha, f, noise) for alpha, f, noise in TRUTHS}
TABLES: dict[str, tuple[dict[str, Any], Callable[..., Any], dict[str, int]]] = {
    "false alarms": (WHITE, rejections, {"30 s": 1, "10 min": 1}),
    "false peaks": (WHITE, false_peaks, {"30 s": 5, "10 min": 5}),
    "power at 5 %": (STRENGTHS, power, {"30 s": 5, "10 min": 10}),
    "verdicts": (FAMILIES, verdicts, {"30 s": 10, "10 min": 10}),
    "verdicts of fractional noise": (NAMED_TRUTHS, fractional_verdicts, {"30 s": 20, "10 min": 20}),
    "coverage": (NAMED_TRUTHS, coverage, {"30 s": 20, "10 min": 20}),
}
"""Rows, what is measured of each, and by how much the number of series is divided."""


def row(title: str, name: str, length: str, seeds: int) -> Any:
    """One row, from a seed of its own, so that rows may be made anywhere and in any order."""
    rows, measure, divide = TABLES[title]
    rng = np.random.default_rng((20260601, zlib.crc32(f"{title}, {name}, {length}".encode())))
    return measure(rows[name], LENGTHS[length], max(seeds // divide[length], 2), rng)


def tables(seeds: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """All tables of simulated series, one after the other, on all cores at the lowest priority."""
    with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn"), initializer=_yield) as pool:
        under_way = {
            title: {
                f"{name}, {length}": pool.submit(row, title, name, length, seeds)
                for length in LENGTHS
                for name in rows
            }
            for title, (rows, _, _) in TABLES.items()
        }
        for title, futures in under_way.items():
            yield title, {label: future.result() for label, future in futures.items()}


def _yield() -> None:
    os.nice(19)


def measure(seeds: int) -> dict[str, Any]:
    """All tables, for `tools.bench`."""
    return dict(tables(seeds))


def text(result: dict[str, Any]) -> str:
    """Tables for people."""
    return "\n".join(
        f"{title}\n" + "\n".join(f"  {name:<42} {_cell(values)}" for name, values in rows.items())
        for title, rows in result.items()
    )


def _cell(values: Any) -> str:
    if not isinstance(values, dict):
        return str(values)
    if "alpha" in values:
        return "".join(
            f"\n    {name:<6} {v['true']:>8.3g}: {v['median']:.3g} ± {v['spread']:.2g}, interval covers "
            + ("–" if v["covered"] is None else f"{v['covered']:.0%}")
            + f", defined {v['defined']:.0%}"
            for name, v in values.items()
        )
    return ", ".join(f"{name}: {value}" for name, value in values.items())


def main() -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="as --seeds 20")
    parser.add_argument("--seeds", type=int, default=1_000, help="series of the largest table")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--recordings", type=Path, help="folder of .npz recordings of sensors at rest")
    arguments = parser.parse_args()
    result: dict[str, Any] = {}
    every = tables(20 if arguments.quick else arguments.seeds)
    if arguments.recordings:
        every = itertools.chain([("recordings", recordings(arguments.recordings))], every)
    for title, rows in every:
        result[title] = rows
        if not arguments.json:
            print("\n" + text({title: rows}), flush=True)
    if arguments.json:
        print(json.dumps(result, ensure_ascii=False))
    return 0


if __name__ == "__main__":
    sys.exit(main())
