"""Judge whether tables 3 and 4 of the paper were exchanged when it was printed, with the evidence.

The paper says that table 3 belongs to example 2 (saw-tooth) and table 4 to example 3 (Gaussian input). Eight
of the paper's numbers are compared with our results of both examples over many seeds. For each table, these
are the errors of state and parameter at L = 4,000, and the changes of these two errors from L = 4,000 to L =
2,000. The error of the order is left out here, since in both tables it fits neither example.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.lab.reproduce import paper
from fltea.lab.reproduce.paper_tables import PAPER, Row, changes, percent_text, percentile, printed_change
from fltea.lab.reproduce.runs import Outcome
from fltea.records.arrays import Array

AS_PRINTED = {3: 2, 4: 3}
EXCHANGED = {3: 3, 4: 2}
"""For tables 3 and 4, the example to which the numbers of a table belong. AS_PRINTED: the examples that the
paper names. EXCHANGED: the examples if each of the two tables is printed in the place of the other.
"""

SHORT = 2000
JUDGED = ("state", "parameter")
FEWEST_SEEDS = 400
"""Least number of seeds for an inference. With few seeds, a percentile of 0 or 100 is no evidence.

Even if no seed has an error as large as the paper's, such errors may occur: in up to 3 / n of all runs, with
95 % confidence from n seeds.
"""
TAIL_PERCENT = 0.5
"""A number of the paper does not fit an example if less than this percentage of the seeds (random runs of the
example) gives a larger number, or less than this percentage gives a smaller one.
"""

Results = Mapping[int, Mapping[int, Outcome]]
"""The results of all seeds, by example and length L. The lengths 4,000 and 2,000 are needed."""


class Place(NamedTuple):
    """The position of one number of the paper among the results of all seeds of one example."""

    table: int
    example: int
    what: str
    """What the number is, as it is called in the text for the reader: "the state's error" or "the change of
    the state's error".
    """
    percentile: float

    @property
    def tail(self) -> float:
        """Percentage of the seeds with a result above the number, or below it, whichever is smaller."""
        return min(self.percentile, 100 - self.percentile)


def evidence(results: Results) -> Row:
    """Return what speaks for and against an exchange of tables 3 and 4, as numbers for JSON.

    Keys:
        as_printed, exchanged: for each of these assumptions, `rarest` is the one of the paper's eight numbers
            that is most extreme among the results of the seeds.
        example_2, example_3: results for the seeds of each example. Changes are those of the error of the
            state, from L = 4,000 to L = 2,000, in percent. `at_least_4`: percentage of seeds with at least
            the change in table 4. `at_most_3`: percentage of seeds with at most the change in table 3.
            `largest_order`: largest error of the order in a finite run; None if it overflows.
    """
    seeds = min(_finite(by_length) for by_length in results.values())
    pairings = {"as_printed": _rarest(results, AS_PRINTED), "exchanged": _rarest(results, EXCHANGED)}
    row: Row = {"seeds": seeds, "inference": _inference(seeds, pairings)}
    for name, rarest in pairings.items():
        row[name] = None if rarest is None else {"rarest": rarest._asdict()}
    size = {table: abs(_relative(table, "state")) for table in (3, 4)}
    for example, by_length in results.items():
        difference, before = changes(by_length, SHORT)["state"]
        order = by_length[paper.SAMPLES].order[~by_length[paper.SAMPLES].not_finite]
        relative = np.abs(difference) / before
        row[f"example_{example}"] = {
            "at_least_4": _share(relative >= size[4]),
            "at_most_3": _share(relative <= size[3]),
            "largest_order": _largest(order),
        }
    return row


def text(found: Row) -> str:
    """Return the evidence on tables 3 and 4 as Markdown text, for a reader with the paper at hand."""
    asked = "Are tables 3 and 4 exchanged in print?"
    heading = {
        "exchanged": "Tables 3 and 4 are most likely exchanged in print: an inference, "
        "the paper does not say so",
        "too few seeds": f"{asked} Too few seeds to tell: each example needs {FEWEST_SEEDS} seeds "
        f"with finite runs, and there are {found['seeds']:,}",
        "cannot be told": f"{asked} With these settings the numbers do not tell",
    }[found["inference"]]
    lines = [_rarest_text(found), _change_text(found), PAPERS_TEXT, _order_text(found)]
    return "\n".join([f"**{heading}.**", "", *(f"- {line}" for line in lines if line)])


PAPERS_TEXT = (
    "The paper's own text says of example 3 that there is no difference between the state estimates of both "
    "lengths, and that a noisy input leads to the same results for both. The numbers of the paper's table 3 "
    "agree with that; those of its table 4 do not."
)


def _rarest_text(found: Row) -> str:
    if found["as_printed"] is None or found["exchanged"] is None:
        return ""
    return (
        "Eight numbers are compared: the errors of state and parameter in both tables at L = 4,000, and "
        "their changes to L = 2,000. If table 3 is of example 2 and table 4 of example 3, as the paper says, "
        f"the rarest number is {_place(found['as_printed'])}. If the tables are exchanged, the rarest is "
        f"{_place(found['exchanged'])}."
    )


def _change_text(found: Row) -> str:
    two, three = found["example_2"], found["example_3"]
    if two["at_least_4"] is None or three["at_least_4"] is None:
        return ""
    much, little = (100 * _relative(table, "state") for table in (4, 3))
    return (
        f"With the shorter length, the state error of table 4 changes by {much:+.1f} %. The state error "
        f"changes by at least as much in {percent_text(three['at_least_4'])} % of the seeds of example 3, "
        f"and in {percent_text(two['at_least_4'])} % of example 2. The state error of table 3 changes by "
        f"{little:+.2f} %. It changes by at most as much in {percent_text(two['at_most_3'])} % of the seeds "
        f"of example 2, and in {percent_text(three['at_most_3'])} % of example 3."
    )


def _order_text(found: Row) -> str:
    largest = [found[f"example_{example}"]["largest_order"] for example in (2, 3)]
    printed = [table[paper.SAMPLES].order for table in (paper.TABLE_3, paper.TABLE_4)]
    if None in largest or max(largest) >= min(printed):
        return ""
    return (
        "The order column fits neither example: the largest error of the order in any seed is "
        f"{largest[0]:,.4g} (example 2) and {largest[1]:,.4g} (example 3), but the paper has "
        f"{printed[0]:,.4g} and {printed[1]:,.4g}. If the order were estimated as 0 throughout, its "
        f"error would be {zero_order_error():,.3g}. `--readings` shows how the choices that the "
        "paper leaves open change the errors."
    )


def zero_order_error() -> float:
    """Return the sum of squared errors of the order in examples 2 and 3 if the estimate were always 0."""
    return float(np.sum((0.2 + 0.1 * paper.H * np.arange(1, paper.SAMPLES + 1)) ** 2))


def _inference(seeds: int, pairings: Mapping[str, Place | None]) -> str:
    printed, exchanged = pairings["as_printed"], pairings["exchanged"]
    if seeds < FEWEST_SEEDS or printed is None or exchanged is None:
        return "too few seeds"
    if printed.tail < TAIL_PERCENT <= exchanged.tail:
        return "exchanged"
    return "cannot be told"


def _rarest(results: Results, pairing: Mapping[int, int]) -> Place | None:
    positions = []
    for table, example in pairing.items():
        outcome, moved = results[example][paper.SAMPLES], changes(results[example], SHORT)
        good = ~outcome.not_finite
        for name in JUDGED:
            level = percentile(getattr(outcome, name)[good], getattr(PAPER[table][paper.SAMPLES], name))
            change = percentile(moved[name][0], printed_change(table, SHORT, name))
            whats = (f"the {name}'s error", f"the change of the {name}'s error")
            for what, found in zip(whats, (level, change), strict=True):
                if found is None:
                    return None
                positions.append(Place(table, example, what, found))
    return min(positions, key=lambda position: position.tail)


def _place(pairing: Row) -> str:
    rarest = pairing["rarest"]
    share = rarest["percentile"]
    where = {0.0: "below all", 100.0: "above all"}.get(share, f"above {percent_text(share)} %")
    what = f"{rarest['what']} in table {rarest['table']}"
    return f"{what}, which is {where} of example {rarest['example']}'s seeds"


def _finite(by_length: Mapping[int, Outcome]) -> int:
    return min(int((~outcome.not_finite).sum()) for outcome in by_length.values())


def _relative(table: int, name: str) -> float:
    return printed_change(table, SHORT, name) / float(getattr(PAPER[table][paper.SAMPLES], name))


def _largest(values: Array) -> float | None:
    largest = float(values.max()) if len(values) else math.inf
    return largest if math.isfinite(largest) else None


def _share(hit: NDArray[np.bool_]) -> float | None:
    return float(100 * np.mean(hit)) if hit.size else None
