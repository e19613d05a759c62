"""Keeps the results of an axis' last refit, so that the next refit can begin at them."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from fltea.spectrum.candidate_models import CandidateModels, native
from fltea.spectrum.likelihood_ratio import p_value
from fltea.spectrum.periodogram import Periodogram, binned

T = TypeVar("T")

GROWN = 1.1
"""When the record has become longer by this factor, models, peaks and changes are searched for again."""


class LastRefit:
    """Results of the last refit of one axis.

    The next refit begins at these results, until the record has grown by a tenth.
    """

    def __init__(self) -> None:
        self._found: dict[str, tuple[Any, float]] = {}

    def forget(self) -> None:
        """Discard all results, so that the next refit searches from the beginning."""
        self._found.clear()

    def result(self, name: str, ordinates: float, compute: Callable[[], T]) -> T:
        """Return the result for `name`, usually that of the last search.

        If the record has grown by a tenth, call `compute` for a new result.
        """
        found, then = self._found.get(name, (None, 0.0))
        if ordinates > GROWN * then:
            found, then = self._found[name] = compute(), ordinates
        return cast(T, found)

    def candidates(self, name: str, p: Periodogram, samples: int) -> CandidateModels:
        """Return the candidate models of these ordinates.

        If the record has grown by a tenth, the models come from a new search. If not, the models of the last
        refit are fitted again.
        """
        data = binned(p)
        last, then = self._found.get(name, (None, 0.0))
        if last is None or data.ordinates > GROWN * then:
            last, then = None, data.ordinates
        found = CandidateModels(data, p.h, samples, last)
        self._found[name] = found.fits, then
        return found

    def null_test(self, name: str, p: Periodogram) -> tuple[float, float]:
        """Return the null test's likelihood ratio on these ordinates, and its p-value."""
        ratio = self.null_ratio(name, p)
        return ratio, p_value(ratio, p.ordinates)

    def null_ratio(self, name: str, p: Periodogram) -> float:
        """Return the null test's likelihood ratio on these ordinates."""
        data = binned(p)
        last, then = self._found.get(name, ([], 0.0))
        if data.ordinates > GROWN * then:
            last, then = [], data.ordinates
        of_order, of_high_pass, eta = native(data, p.h, p.n).null_test(last)
        self._found[name] = eta, then
        return max(of_order, of_high_pass, 0.0)


def null_ratio(p: Periodogram) -> float:
    """Return the null test's likelihood ratio on these ordinates, with fits from all starting points."""
    return LastRefit().null_ratio("", p)
