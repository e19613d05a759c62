"""How far the device's own estimates are from the host's: its float over integers against double.

Usage: make bench ARGS="--device [--json]", or python -m tools.bench.device_difference [--json] [--samples N]
[--recordings DIR]

One axis after another, its own start-up window and then up to N samples (1,000,000), by the device's code
compiled for this machine (tests/native/device_probe.cpp), and by the host's engine with the same settings
over a memory of nine digits without an end. Half a minute.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from fltea.noise.simulation import quantise
from numpy.typing import NDArray

from tools.bench.identify_tables import fractional_state

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests/rig"))
from device_probe import LSB_PER_DPS, STARTUP, VARIANTS, Device, host_baseline, host_engine

Counts = NDArray[np.int16]

RECORDINGS = Path(__file__).resolve().parents[3] / "shared/recordings"
AGES = (3_000, 100_000, 1_000_000)
CHUNK = 50_000
FULL_SCALE_DPS = 2_000.0
SIGMA_DPS = 0.15
"""of the simulated noise, offset 1 deg/s"""


def simulated(n: int) -> Iterator[tuple[str, Counts]]:
    """Noise of known kinds at the device's sensitivity."""
    for name, alpha, f in (("white", 0.0, 0.0), ("α 0.3, f -1", 0.3, -1.0), ("α 0.6, f -3", 0.6, -3.0)):
        rng = np.random.default_rng(20260601)
        noise = rng.standard_normal(n) if name == "white" else fractional_state(alpha, f)(n, rng)
        yield name, quantise(1 + SIGMA_DPS * noise / noise.std(), LSB_PER_DPS, FULL_SCALE_DPS)


def recorded(folder: Path) -> Iterator[tuple[str, Counts]]:
    """The axes of real sensors' recordings, in counts of the device's sensitivity."""
    for file in sorted(folder.glob("*.npz")):
        with np.load(file) as d:
            counts = np.rint(d["gyro_raw"] * (LSB_PER_DPS / float(d["lsb_per_dps"]))).astype(np.int16)
        for axis, name in enumerate("xyz"):
            yield f"{file.stem} {name}", counts[:, axis]


def differences(variant: str, counts: Counts) -> dict[str, Any]:
    """The largest |Δα| and |Δf| up to each age and at the end, and how often the guard acted."""
    bias, R = host_baseline(counts[:STARTUP])
    device, host = Device(variant), host_engine(variant, R)
    device.run(counts[:STARTUP])
    alphas, fs = [], []
    valid = True
    for first in range(STARTUP, len(counts), CHUNK):
        part = counts[first : first + CHUNK]
        rows, expected = device.run(part), host.run(part[:, None] / LSB_PER_DPS - bias)
        alphas.append(np.abs(rows["alpha"] - expected.alpha[:, 0]))
        fs.append(np.abs(rows["f"] - expected.f[:, 0]))
        valid = valid and bool((rows["flags"] == 1).all())
    alpha, f = np.concatenate(alphas), np.concatenate(fs)
    n = len(alpha)
    ages = [age for age in AGES if age < n] + [n]
    return {
        "samples": n,
        "always_valid": valid,
        "interventions": int(sum(host.interventions()[0])),
        "alpha": float(expected.alpha[-1, 0]),
        "f": float(expected.f[-1, 0]),
        "worst": {age: {"alpha": float(alpha[:age].max()), "f": float(f[:age].max())} for age in ages},
        "end": {"alpha": float(alpha[-1]), "f": float(f[-1])},
    }


def measure(samples: int = AGES[-1], folder: Path = RECORDINGS) -> dict[str, Any]:
    """By variant and series; without the recordings where they are not at hand."""
    series = [*recorded(folder), *simulated(STARTUP + samples)]
    return {variant: {name: differences(variant, counts) for name, counts in series} for variant in VARIANTS}


def text(result: dict[str, Any]) -> str:
    """A table a variant."""
    lines = []
    for variant, rows in result.items():
        lines.append(f"{variant:<28}{'samples':>10}   worst |Δα| (|Δf|) up to there, and at the end")
        for name, row in rows.items():
            cells = [f"{age:,}: {w['alpha']:.1e} ({w['f']:.1e})" for age, w in row["worst"].items()]
            cells.append(f"end: {row['end']['alpha']:.1e} ({row['end']['f']:.1e})")
            acted = f", guard {row['interventions']} times" if row["interventions"] else ""
            withdrawn = "" if row["always_valid"] else ", NOT ALWAYS VALID"
            lines.append(f"  {name:<26}{row['samples']:>10,}   {'; '.join(cells)}{acted}{withdrawn}")
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--samples", type=int, default=AGES[-1], help="of each simulated series")
    parser.add_argument("--recordings", type=Path, default=RECORDINGS, help="folder of .npz recordings")
    arguments = parser.parse_args()
    result = measure(arguments.samples, arguments.recordings)
    print(json.dumps(result, ensure_ascii=False) if arguments.json else text(result))


if __name__ == "__main__":
    main()
