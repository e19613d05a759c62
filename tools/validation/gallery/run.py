"""The gallery: every noise, several rates and lengths, and the verdict on each record."""

import zlib
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from functools import cache
from typing import Any, Literal

import msgspec
import numpy as np
from fltea.identification.sums import examined
from fltea.identification.workers import Workers
from fltea.records.errors import FlteaError
from fltea.records.fit import VerdictKind
from fltea.spectrum.verdict import decide
from numpy.typing import NDArray

from tools.validation.gallery.noises import NOISES
from tools.validation.gallery.right import Right, right_verdicts

Array = NDArray[np.float64]

RATES_HZ = (5.0, 100.0, 1_000.0)
LENGTHS_S = (30.0, 600.0, 10_800.0)
QUICK = (100.0, 600.0)
"""Rate and length of the quick run."""
LARGE = 2_000_000
"""Samples, of records of which each takes up to two gigabytes while it is drawn."""
MARGIN = 6.0
"""In 2 log L, by which a claim of an order has to be ahead of every sum of relaxations."""

Outcome = Literal["right", "cannot be told", "wrong"]
Progress = Callable[[str], None]


class Cell(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One record of one noise."""

    noise: str
    rate_hz: float
    duration_s: float
    series: int
    """number of the record, from 0"""

    @property
    def samples(self) -> int:
        """In the record."""
        return round(self.rate_hz * self.duration_s)


class Seen(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The verdict on one record, and whether it is right."""

    cell: Cell
    kind: VerdictKind
    text: str
    outcome: Outcome
    right: tuple[VerdictKind, ...]
    """what would have been"""
    reason: str
    """why it cannot be told"""
    has_order: bool
    """the noise has one"""
    ahead: float | None
    """2 log L of the best fractional order over the best sum of relaxations; None: not compared"""


class Gallery(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All of it."""

    seen: tuple[Seen, ...]

    def count(self, outcome: Outcome) -> int:
        """Records with this outcome."""
        return sum(one.outcome == outcome for one in self.seen)

    @property
    def without_order(self) -> list[Seen]:
        """Records of noises without an order."""
        return [one for one in self.seen if not one.has_order]

    @property
    def false_orders(self) -> int:
        """Of these, records that are called fractional."""
        return sum(one.kind == "fractional" for one in self.without_order)

    @property
    def tellable(self) -> list[Seen]:
        """Records of noises with an order, of which nothing but "fractional" is right."""
        return [one for one in self.seen if one.has_order and one.right == ("fractional",)]

    @property
    def close_claims(self) -> int:
        """Claims of "fractional" with a rival that is not `MARGIN` behind."""
        claims = [one for one in self.seen if one.kind == "fractional"]
        return sum(one.ahead is None or one.ahead <= MARGIN for one in claims)


def cells(
    series: int,
    names: Iterable[str] = tuple(NOISES),
    rates_hz: Sequence[float] = RATES_HZ,
    lengths_s: Sequence[float] = LENGTHS_S,
) -> list[Cell]:
    """All records of these noises."""
    return [
        Cell(name, rate, length, number)
        for name in names
        for rate in rates_hz
        for length in lengths_s
        for number in range(series)
    ]


def draw(cell: Cell) -> Array:
    """The samples of one record, always the same."""
    seed = [cell.series, zlib.crc32(cell.noise.encode()), round(cell.rate_hz), cell.samples]
    return NOISES[cell.noise].draw(cell.samples, cell.rate_hz, np.random.default_rng(seed))


def look(cell: Cell) -> Seen:
    """Draw one record and ask for the verdict on it, on the path of `fltea identify`."""
    y = draw(cell)
    if (y == y[0]).all():
        return judged(cell, "constant", "All samples are the same.", None)
    evidence = examined(y, 1 / cell.rate_hz).evidence
    verdict = decide(evidence)
    ahead = evidence.contest.order_gain - evidence.contest.sum_gain
    return judged(cell, verdict.kind, verdict.text, ahead)


def judged(cell: Cell, kind: VerdictKind, text: str, ahead: float | None) -> Seen:
    """Whether a verdict on a record is right."""
    truth = _right(cell.noise, cell.rate_hz, cell.samples)
    outcome: Any = truth.outcome(kind)
    reason = truth.accepted.get(kind, "") if outcome == "cannot be told" else ""
    return Seen(cell, kind, text, outcome, tuple(sorted(truth.right)), reason, truth.has_order, ahead)


@cache
def _right(name: str, rate_hz: float, samples: int) -> Right:
    return right_verdicts(NOISES[name], rate_hz, samples)


def visit(
    wanted: Sequence[Cell],
    workers: Workers,
    *,
    known: Iterable[Seen] = (),
    keep: Callable[[Seen], None] = lambda seen: None,
    progress: Progress = lambda text: None,
) -> Gallery:
    """Look at all records; what comes out depends neither on the workers nor on the order of their work.

    known: what an earlier run saw, which is not drawn again. keep: gets each as it is done.

    Raises:
        FlteaError: a worker died.
    """
    # What is right may have been thought over since.
    found = {one.cell: judged(one.cell, one.kind, one.text, one.ahead) for one in known}
    # The longest first, so that no process waits for one at the end.
    waiting = sorted((cell for cell in wanted if cell not in found), key=lambda cell: cell.samples)
    pending: dict[Future[Seen], Cell] = {}
    while waiting or pending:
        try:
            while waiting and len(pending) < _room(workers, waiting[-1]):
                cell = waiting.pop()
                pending[workers.submit(look, cell)] = cell
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                cell = pending.pop(future)
                found[cell] = future.result()
                keep(found[cell])
                progress(cell.noise)
        except BrokenExecutor as error:
            raise FlteaError(
                "a process that looked at a record was killed; did memory run out? Try --jobs 1."
            ) from error
    return Gallery(tuple(found[cell] for cell in wanted))


def _room(workers: Workers, following: Cell) -> int:
    """Records at a time: of large ones none waits in memory."""
    return max(1, workers.slots - 1) if following.samples > LARGE else workers.slots
