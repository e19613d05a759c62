"""Score the guards: do they prevent divergence, and how much accuracy do they cost otherwise?

A guard keeps the filters from diverging. There are two kinds of cases. Driven cases are examples 1–3 of the
paper with other inputs. Resting cases are the gyroscope of the paper's section 7: with white noise and a
wrong R, with offsets that are not removed, and with data that are no noise at all. `runs` defines which runs
are not finite and which are far off. At rest, the estimated state is compared with the measurement.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fltea.estimator.engine import Engine
from fltea.lab.reproduce import paper
from fltea.lab.reproduce.runs import Options, Outcome, far_off, lane_settings, not_finite, outcomes
from fltea.lab.reproduce.scenarios import GYROSCOPE_FILTERS, SawTooth, Scenario, example
from fltea.lab.reproduce.simulate import WIDTH
from fltea.records.arrays import Array

GUARDS: tuple[Literal["off", "faithful", "consistent"], ...] = ("off", "faithful", "consistent")
SAWTEETH = (
    *(SawTooth(amplitude) for amplitude in (0.5, 1.0, 5.0, 20.0)),
    *(SawTooth(amplitude, unipolar=True) for amplitude in (1.0, 5.0, 20.0)),
)
SPIKE_DPS = 2000.0
LSB_DPS = 1 / 16.4


@dataclass(frozen=True)
class Resting:
    """A case with the samples of a gyroscope at rest, some of them with a fault such as spikes.

    `turn`: function that makes the samples from white noise of variance V. `R_over_V`: R of the filters, as a
    multiple of V.
    """

    name: str
    turn: Callable[[Array], Array] = lambda noise: noise
    R_over_V: float = 1.0


def _spikes(noise: Array) -> Array:
    spiked = noise.copy()
    spiked[500::500] += SPIKE_DPS
    return spiked


RESTING = (
    *(
        Resting(f"white noise, R/V = {ratio:g}", R_over_V=ratio)
        for ratio in (0.1, 0.3, 0.5, 1.0, 2.0, 3.0, 10.0)
    ),
    *(Resting(f"offset {d:g} deg/s", lambda noise, d=d: noise + d) for d in (0.1, 1.0, 5.0)),  # type: ignore[misc]
    Resting(
        "step of 10 deg/s", lambda noise: noise + 10.0 * (np.arange(len(noise)) >= len(noise) // 2)[:, None]
    ),
    Resting("spikes of 2000 deg/s", _spikes),
    Resting("constant 1 deg/s", lambda noise: np.full_like(noise, 1.0)),
    Resting("all zeros", np.zeros_like),
    Resting("saturated at 2000 deg/s", lambda noise: np.clip(noise * 1e6, -SPIKE_DPS, SPIKE_DPS)),
    Resting("one LSB flickering", lambda noise: LSB_DPS * np.sign(noise)),
    Resting("scale 1e-12", lambda noise: noise * 1e-12),
    Resting("scale 1e+12", lambda noise: noise * 1e12),
)


def driven() -> list[Scenario]:
    """Return the driven cases: the paper's examples 1 and 2 with each input in `SAWTEETH`, and example 3.

    Each has its longest L only, the number of past states that the filters use.
    """
    cases = [example(number, sawtooth) for number in (1, 2) for sawtooth in SAWTEETH]
    return [replace(case, lengths=case.lengths[:1]) for case in [*cases, example(3, SawTooth())]]


def steps(seeds: int) -> int:
    """Return the number of runs that `score` makes."""
    return len(GUARDS) * seeds * (len(driven()) + len(RESTING))


def score(seeds: int, options: Options, advance: Callable[[str, int], None]) -> list[dict[str, Any]]:
    """Return one row for each case and guard; `options.guard` is ignored.

    Keys (`Outcome` says which runs are not finite, and which are far off):
        not_finite, far_off: numbers of such runs.
        state, parameter, order: for driven cases, medians of the squared errors over all finite runs.
        kept: the same medians, but over the seeds whose run without a guard is finite and not far off.
        alpha, f: for a gyroscope at rest, medians of the last estimates of all finite runs.

    A median that overflows, or that has no run, is None.
    """
    rows = []
    for simulated in driven():
        # the samples are computed only once, and each kind of guard (see the module) runs over them
        case = replace(simulated, make=cache(simulated.make))
        name = f"{case.title}, {case.source}"
        told = partial(advance, name)
        printed: Outcome | None = None
        for guard in GUARDS:
            outcome = outcomes(case, range(seeds), replace(options, guard=guard), told)[case.lengths[0]]
            printed = outcome if printed is None else printed
            rows.append(
                {
                    "case": name,
                    "guard": guard,
                    "seeds": seeds,
                    "not_finite": int(outcome.not_finite.sum()),
                    "far_off": int(outcome.far_off.sum()),
                    **_medians(outcome, ~outcome.not_finite),
                    "kept": _medians(outcome, ~printed.not_finite & ~printed.far_off),
                }
            )
    for rest in RESTING:
        for guard in GUARDS:
            rows.append(_at_rest(rest, range(seeds), replace(options, guard=guard)))
            advance(rest.name, seeds)
    return rows


def _medians(outcome: Outcome, chosen: NDArray[np.bool_]) -> dict[str, float | None]:
    columns = {"state": outcome.state, "parameter": outcome.parameter, "order": outcome.order}
    return {name: _median(values[chosen]) for name, values in columns.items()}


def _at_rest(case: Resting, seeds: Sequence[int], options: Options) -> dict[str, Any]:
    V, n = paper.GYRO_R["x"], paper.GYRO_SAMPLES
    R = V * case.R_over_V
    filters = replace(GYROSCOPE_FILTERS, R=R)
    settings = lane_settings(filters, n, options)
    lost, far, alpha, f = [], [], [], []
    for first in range(0, len(seeds), WIDTH):
        group = seeds[first : first + WIDTH]
        noise = [np.random.default_rng((seed, 7)).normal(0, math.sqrt(V), n) for seed in group]
        y = case.turn(np.column_stack(noise))
        got = Engine(len(group), settings).run(y)
        lost.append(not_finite(got))
        far.append(far_off(got, y, math.sqrt(R)))
        alpha.append(got.alpha[-1])
        f.append(got.f[-1])
    kept = ~np.concatenate(lost)
    return {
        "case": case.name,
        "guard": options.guard,
        "seeds": len(seeds),
        "not_finite": int((~kept).sum()),
        "far_off": int((np.concatenate(far) & kept).sum()),
        "alpha": _median(np.concatenate(alpha)[kept]),
        "f": _median(np.concatenate(f)[kept]),
    }


def _median(values: Array) -> float | None:
    median = float(np.median(values)) if len(values) else math.nan
    return median if math.isfinite(median) else None


def document(rows: Sequence[dict[str, Any]]) -> str:
    """Return the rows of `score` as two Markdown tables, with one table row for each case."""
    cases: dict[str, dict[str, dict[str, Any]]] = {}
    for row in rows:
        cases.setdefault(row["case"], {})[row["guard"]] = row
    head = ["", "| case | off | faithful | consistent |", "|---|---|---|---|"]
    driven_lines, resting_lines = (
        [_line(case, by) for case, by in cases.items() if key in by["off"]] for key in ("state", "alpha")
    )
    lines = [
        "Each cell: number of runs that are not finite + number of runs that are far off: medians of the "
        "squared errors of state / parameter / order over the finite runs (in brackets: medians over the "
        "seeds whose run of the paper's algorithm is finite and not far off).",
        *head,
        *driven_lines,
        "",
        "At rest: number of runs that are not finite + number of runs that are far off: medians of the last "
        "α / f over the finite runs.",
        *head,
        *resting_lines,
    ]
    return "\n".join(lines) + "\n"


def _line(case: str, by_guard: dict[str, dict[str, Any]]) -> str:
    cells = []
    some_lost = by_guard["off"]["not_finite"] + by_guard["off"]["far_off"] > 0
    for guard in GUARDS:
        row = by_guard[guard]
        lost = f"{row['not_finite']} + {row['far_off']}"
        if "alpha" in row:
            cells.append(f"{lost}: {_numbers(row, ('alpha', 'f'))}")
            continue
        names = ("state", "parameter", "order")
        kept = f" ({_numbers(row['kept'], names)})" if some_lost and row["kept"]["state"] is not None else ""
        cells.append(f"{lost}: {_numbers(row, names)}{kept}")
    return f"| {case} | {' | '.join(cells)} |"


def _numbers(row: dict[str, Any], names: Sequence[str]) -> str:
    return " / ".join("–" if row[name] is None else f"{row[name]:.3g}" for name in names)
