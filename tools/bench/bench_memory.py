"""Measures the filters' compressed memory, which stands for all past samples by some decaying sums (modes).

The memory is measured for several accuracies (numbers of digits), lengths (windows) and numbers of axes that
are processed in parallel (lanes). The figures are the number of modes, the accuracy and the time of a step.

A step is all that the estimator needs from its memory for one sample. It computes weighted sums of the past
states for four orders, and for the fourth order also that of their variances. Then it adds the new state.
Each of these operations waits for the one before. The tables have the largest relative error of the weights,
for ages up to ten million samples and all orders.
"""

import statistics
from typing import Any

import mpmath
import numpy as np

from tests.rig.memory_probe import DIRECT, SETS, Memory
from tools.validation.tables import NONE, Table, number

DIGITS = (3, 4, 5, 6, 7, 8, 9, 10, 11)
WINDOWS = (1000, 3000, 10_000, 100_000, 1_000_000, 0)
RANGES = ((-0.9, 0), (0, 1), (1, 2), (2, 3))
REPETITIONS = 31
AGES = 10_000_000


class Timed(Memory):
    """A memory that measures its own time and size."""

    def seconds(self, n: int) -> float:
        """Return the time of `n` steps. The module's docstring says what a step is."""
        return float(self._library.probe_seconds(self._probe, n))

    @property
    def bytes(self) -> int:
        """Return the size of the memory of all axes that are processed in parallel [bytes]."""
        return int(self._library.probe_bytes(self._probe))

    @property
    def grid_step(self) -> float:
        """Return the distance between the logarithms of the decay rates of neighbouring modes."""
        out = np.zeros(3)
        self._library.probe_nodes(self._probe, out)
        return float(out[2])


def worst_errors(memory: Memory, low: float, high: float) -> tuple[float, float]:
    """Return the memory's largest relative errors of the weights c_j and c_j^2, for orders `low` to `high`.

    c_j is the weight of the sample that is j samples old in a fractional difference. The errors are computed
    for a grid of ages.
    """
    ages = np.unique(np.geomspace(16, AGES, 60).astype(int))
    worst = [0.0, 0.0]
    for order in np.linspace(low, high, 7)[1 if low >= 0 else 0 : -1]:
        memory.reset()
        memory.push([1.0], [1.0])
        age = 1
        for j in ages.tolist():
            memory.push_zeros(j - age)
            age = j
            S, V = memory.sums(order)
            with mpmath.workdps(30):
                a = mpmath.mpf(float(order))
                c = mpmath.gammaprod([j - a], [-a, j + 1])
                errors = float(abs(S[0] / c - 1)), float(abs(V[0] / c**2 - 1))
            worst = [max(pair) for pair in zip(worst, errors, strict=True)]
    return worst[0], worst[1]


def nanoseconds(memory: Timed, window: int) -> float:
    """Return the median time [ns] of a step when the memory has reached its full length.

    Each timed batch of steps is shorter than a time slice of the system's scheduler.
    """
    memory.stir(window or 10_000, 1)
    steps = max(50, int(4e5 / (memory.seconds(50) / 50 * 1e9)))
    return statistics.median(memory.seconds(steps) / steps * 1e9 for _ in range(REPETITIONS))


def measure() -> dict[str, list[dict[str, Any]]]:
    """Return the rows of each table."""
    by_digits = []
    for digits in DIGITS:
        memory = Timed(digits)
        limited = Timed(digits, 3000)
        state, variance = limited.modes
        by_digits.append(
            {
                "digits": digits,
                "state_modes": state,
                "variance_modes": variance,
                "grid_step": limited.grid_step,
                "unlimited_modes": memory.modes,
                "weight_error": {f"{low}..{high}": worst_errors(memory, low, high) for low, high in RANGES},
                "ns_per_step": nanoseconds(Timed(digits, 3000, "w"), 3000),
            }
        )
    by_window = [
        {
            "instruction_set": name,
            "lanes": Timed(6, 10, "w", name).lanes,
            "window": window or "unlimited",
            "modes": Timed(6, window).modes,
            "bytes": Timed(6, window, "w", name).bytes,
            "ns_per_step": nanoseconds(Timed(6, window, "w", name), window),
        }
        for name in SETS
        for window in WINDOWS
    ]
    direct = [
        {
            "instruction_set": name,
            "lanes": Timed(DIRECT, 10, kind, name).lanes,
            "window": 3000,
            "ns_per_step": nanoseconds(Timed(DIRECT, 3000, kind, name), 3000),
        }
        for name in SETS
        for kind in "dw"
    ]
    return {"by_digits": by_digits, "by_window": by_window, "direct": direct}


def text(found: dict[str, list[dict[str, Any]]]) -> str:
    """Return the figures as tables in Markdown."""
    by_digits = [
        (
            f"{row['digits']}",
            f"{row['state_modes']} + {row['variance_modes']}",
            *(f"{of_c:.0e} ({of_square:.0e})" for of_c, of_square in row["weight_error"].values()),
            f"{row['ns_per_step']:.0f}",
        )
        for row in found["by_digits"]
    ]
    headings = ("digits", "modes at L = 3000", *(f"{low} .. {high}" for low, high in RANGES), "ns a step")
    tables = [Table("Worst relative error of c_j (of its square), by order", headings, by_digits)]
    for title, rows in (("Compressed, 6 digits", found["by_window"]), ("Direct", found["direct"])):
        cells = [
            (
                *(f"{row[name]}" for name in ("instruction_set", "lanes", "window")),
                *(f"{row['ns_per_step'] / lanes:.1f}" for lanes in (1, row["lanes"])),
                " + ".join(map(str, row.get("modes", ()))) or NONE,
                number(row.get("bytes"), ",d"),
            )
            for row in rows
        ]
        headings = ("instructions", "lanes", "L", "ns a step", "ns a lane", "modes", "bytes")
        tables.append(Table(title, headings, cells))
    return "\n".join(one.markdown() for one in tables)
