"""Vary each choice that the paper leaves open, one at a time, and compare our errors with the paper's.

With every choice, examples 1 to 3 are run for many seeds with the full memory (L = 4,000). The results are
the medians of our errors over the seeds, and the percentile of each error in the paper's tables 2 to 4: the
percentage of seeds with a smaller error. Tables 3 and 4 are each compared with both examples 2 and 3, since
the two tables may have been exchanged when the paper was printed (`exchange`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from fltea.lab.reproduce import paper, readings
from fltea.lab.reproduce.paper_tables import EXAMPLES, PAPER, Row, outcome_row, percent_text, percentile
from fltea.lab.reproduce.readings import Reading
from fltea.lab.reproduce.runs import Curves, Options, Outcome, estimate, outcomes
from fltea.lab.reproduce.scenarios import Data, SawTooth, Scenario, example

NEAR = 1.5
"""Our error of the order counts as near the paper's if neither is more than this many times the other."""
WIDTH = 16
"""Number of runs that `readings` processes together, for an interpretation that the engine does not have. In
each run, the order is different, and so are the weights of past states. The weights of so few runs fit into
the processor's cache.
"""


AS_BUILT = Reading()
"""The engine's interpretation of the paper's algorithm."""
CHOSEN_SAWTOOTH = SawTooth()


@dataclass(frozen=True)
class Choice:
    """One way to make a choice that the paper leaves open.

    All other open choices are made as in this project.
    """

    name: str
    reading: Reading = AS_BUILT
    sawtooth: SawTooth = CHOSEN_SAWTOOTH
    omega_outside: bool = False
    order_P0: float | None = None
    """Initial variance of the order in place of the paper's 0.05; None: 0.05."""

    def scenario(self, number: int, samples: int = paper.SAMPLES) -> Scenario:
        """Return example 1, 2 or 3 under this choice, with the full memory."""
        made = example(number, self.sawtooth, samples, omega_outside=self.omega_outside)
        made = replace(made, lengths=(paper.SAMPLES,))
        if self.order_P0 is None:
            return made
        order = msgspec.structs.replace(made.filters.config.order, P0=self.order_P0)
        config = msgspec.structs.replace(made.filters.config, order=order)
        return replace(made, filters=replace(made.filters, config=config))

    def run(self, scenario: Scenario, data: Data, length: int, options: Options) -> Curves:
        """Return the estimates of every run.

        The engine makes them if `reading`, the interpretation of the paper's algorithm, is the engine's.
        """
        if self.reading == AS_BUILT:
            return estimate(scenario, data, length, options)
        return readings.run(scenario.filters, self.reading, data)


CHOSEN = (
    "κ = 2, covariance sums from i = 0, KFo before KFw, saw-tooth ±1, ω within h^α, the state's variance "
    "left out of P_yy"
)
CHOICES = (
    Choice("as chosen"),
    Choice("saw-tooth ±1.2", sawtooth=SawTooth(1.2)),
    Choice("ω outside h^α", omega_outside=True),
    Choice("κ = 0", Reading(kappa=0.0)),
    Choice("sums from i = 1, as printed", Reading(sums_from=1)),
    Choice("κ = 0, sums from i = 1", Reading(kappa=0.0, sums_from=1)),
    Choice("KFw before KFo", Reading(parameter_first=True)),
    Choice("the state's variance in P_yy", Reading(state_variance=True)),
    Choice("initial variance of the order 500 in place of the printed 0.05", order_P0=500.0),
)


def steps(seeds: int, choices: Sequence[Choice] = CHOICES) -> int:
    """Return the number of runs that `compare` makes."""
    return len(choices) * len(paper_examples()) * seeds


def paper_examples() -> tuple[int, ...]:
    """Return the examples that tables 2 to 4 are compared with."""
    return tuple(sorted({number for examples in EXAMPLES.values() for number in examples}))


def compare(
    seeds: int,
    advance: Callable[[str, int], None],
    choices: Sequence[Choice] = CHOICES,
    samples: int = paper.SAMPLES,
) -> list[Row]:
    """Run the examples with each choice, and return a row of results for each choice.

    `advance` is called with the name of the choice and the number of runs that were just finished.

    Keys:
        examples: result of `outcome_row` for each example.
        percentiles: percentiles of the paper's errors at L = 4,000 among ours.
        near_order: number of seeds whose error of the order is near that of the paper (NEAR).

    `percentiles` and `near_order` have an entry for each table, and in it one for each example that the table
    is compared with.
    """
    return [_row(choice, seeds, samples, advance) for choice in choices]


def _row(choice: Choice, seeds: int, samples: int, advance: Callable[[str, int], None]) -> Row:
    found: dict[int, Outcome] = {}
    for number in paper_examples():
        scenario = choice.scenario(number, samples)
        by_length = outcomes(
            scenario, range(seeds), Options(), lambda n: advance(choice.name, n), choice.run, WIDTH
        )
        found[number] = by_length[paper.SAMPLES]
    return {
        "choice": choice.name,
        "seeds": seeds,
        "examples": {str(number): outcome_row(outcome, None) for number, outcome in found.items()},
        "percentiles": _against(lambda table, number: _places(table, found[number])),
        "near_order": _against(lambda table, number: _near_order(table, found[number])),
    }


def _against(tell: Callable[[int, int], Any]) -> Row:
    """Call `tell(table, example)` for each table of the paper and each example that it is compared with.

    Return the results by table and example.
    """
    return {
        str(table): {str(number): tell(table, number) for number in numbers}
        for table, numbers in EXAMPLES.items()
    }


def _near_order(table: int, outcome: Outcome) -> int:
    printed, orders = PAPER[table][paper.SAMPLES].order, outcome.order[~outcome.not_finite]
    return int(np.sum((orders > printed / NEAR) & (orders < printed * NEAR)))


def _places(table: int, outcome: Outcome) -> dict[str, float | None]:
    printed, good = PAPER[table][paper.SAMPLES], ~outcome.not_finite
    return {
        name: percentile(getattr(outcome, name)[good], getattr(printed, name)) for name in paper.QUANTITIES
    }


def document(rows: Sequence[Row]) -> str:
    """Return two Markdown tables, with a row for each choice that the paper leaves open.

    They show our errors, and the percentiles of the paper's errors among ours.
    """
    seeds = rows[0]["seeds"]
    against = [(table, number) for table, numbers in EXAMPLES.items() for number in numbers]
    heads = [f"table {t} in example {n}" + (", exchanged" if n != EXAMPLES[t][0] else "") for t, n in against]
    cells = [
        [row["choice"], *(_percentiles(row["percentiles"][str(t)][str(n)]) for t, n in against), _near(row)]
        for row in rows
    ]
    printed = " / ".join(f"{table[paper.SAMPLES].order:,.4g}" for table in PAPER.values())
    lines = [
        f"**What the paper leaves open, one choice at a time.** As chosen: {CHOSEN}. {seeds:,} seeds, "
        "L = 4,000. Each cell: number of runs that are not finite + number of runs that are far off: medians "
        "of the squared errors of state / parameter / order over the finite runs.",
        "",
        *_table(
            ["choice", *(f"example {number}" for number in paper_examples())], [_errors(row) for row in rows]
        ),
        "",
        "Percentiles of the paper's errors of state / parameter / order at L = 4,000 among the finite seeds "
        f"(standard error up to {50 / seeds**0.5:.2g}). The last column counts the seeds whose error of the "
        f"order is within a factor of {NEAR:g} of the paper's {printed}; for tables 3 and 4, the example "
        "with more such seeds is shown.",
        "",
        *_table(["choice", *heads, "near the printed order: table 2 / 3 / 4"], cells),
    ]
    return "\n".join(lines) + "\n"


def _table(heads: Sequence[str], body: Sequence[Sequence[str]]) -> list[str]:
    lines = [f"| {' | '.join(cells)} |" for cells in (heads, *body)]
    return [lines[0], "|" + "---|" * len(heads), *lines[1:]]


def _errors(row: Row) -> list[str]:
    cells = [row["choice"]]
    for found in row["examples"].values():
        medians = " / ".join(_number(found[name]["median"]) for name in paper.QUANTITIES)
        cells.append(f"{found['not_finite']} + {found['far_off']}: {medians}")
    return cells


def _percentiles(percentiles: Mapping[str, float | None]) -> str:
    return " / ".join("–" if share is None else percent_text(share) for share in percentiles.values())


def _near(row: Row) -> str:
    return " / ".join(str(max(by_example.values())) for by_example in row["near_order"].values())


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"
