"""Measures the bias tracker: its time per sample and axis, and the time to give it a new noise model.

The times depend on the number of the model's state variables.
"""

import math
import statistics
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from fltea.estimator.tracker import Tracker
from fltea.noise import parts as p
from fltea.noise.linear_system import System
from fltea.noise.system import system

from tools.bench.measured import cpu_seconds, in_turns
from tools.validation.tables import Table

AXES, SAMPLES, ROUNDS, H = 3, 60_000, 5, 0.01
FIRST = 3000
"""Number of samples (half a minute) before the first model is set. Until then the tracker uses its general
models, the tracker bank.
"""


def systems() -> dict[str, System]:
    """Return noise models, as systems with 0, 1, 4 and about 13 state variables."""
    low_passed = [p.White(1.0), p.Relaxation(0.5, 0.5), p.LowPass(25.0, 2.0)]
    order = [p.White(1.0), p.Order(0.7, -1.0, 0.3 / H**1.4)]
    return {
        "white noise, offset given": system([p.White(1.0)], H, 1),
        "walk": system([p.White(1.0), p.Walk(math.sqrt(1e-3 / H))], H, 1),
        "relaxation behind a low-pass": system(low_passed, H, 10**5).with_offset(),
        "order": system(order, H, 10**4).with_offset(),
    }


def measure() -> list[dict[str, Any]]:
    """Measure the tracker with each of the models."""
    y = np.random.default_rng(1).standard_normal((SAMPLES, AXES))
    rows = []
    for name, s in systems().items():
        offset = 0.0 if not s.walks and not np.any(s.a == 1) else None
        one = Tracker([offset] * AXES)
        one.run(y[:FIRST])

        def again(one: Tracker = one, s: System = s) -> None:
            for lane in range(AXES):
                one.set(lane, s)

        again()
        works: dict[str, Callable[[], float]] = {
            "set": partial(cpu_seconds, again),
            "run": partial(cpu_seconds, partial(one.run, y)),
        }
        found = {kind: statistics.median(times) for kind, times in in_turns(works, ROUNDS).items()}
        rows.append(
            {
                "model": name,
                "coordinates": len(s.a),
                "ns_per_sample": found["run"] / y.size * 1e9,
                "us_to_set": found["set"] / AXES * 1e6,
            }
        )
    first = statistics.median(
        cpu_seconds(lambda: Tracker([None] * AXES).run(y[:FIRST])) for _ in range(ROUNDS)
    )
    rows.append(
        {
            "model": "bank, its first half minute",
            "coordinates": None,
            "ns_per_sample": first / (FIRST * AXES) * 1e9,
            "us_to_set": None,
        }
    )
    return rows


def text(found: list[dict[str, Any]]) -> str:
    """Return the figures as a table."""
    cells = [
        (
            row["model"],
            *(
                "" if row[k] is None else f"{row[k]:.0f}"
                for k in ("coordinates", "ns_per_sample", "us_to_set")
            ),
        )
        for row in found
    ]
    headings = ("model", "coordinates", "ns a sample and axis (goal 60)", "µs to set it")
    return Table("The tracker", headings, cells).markdown()
