"""The running test of whiteness in numpy: the oracle of the native one (fltea.estimator.running_null)."""

import math
from collections.abc import Iterable, Sequence
from itertools import repeat
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEWEST = 1_000
"""Samples before which nothing is said."""

LEVEL = 0.001
EFFECTIVE = 8
CHUNK = 128
"""Values that a level takes at a time: one by one, numpy would cost a hundred times as much."""

LAGS = 8
FACTOR = 4
LEVELS = 8
FEWEST_PAIRS = 100
_LAG = np.arange(1, LAGS + 1)
_BEFORE = LAGS - _LAG[:, np.newaxis] + np.arange(CHUNK)
"""Places of what stands 1, ..., 8 before each value of a chunk, in the chunk with its tail, (lags, CHUNK)."""

_RATIOS = np.array([np.maximum(span - _LAG, 0) for span in (4, 8)], dtype=np.float64)
"""Weights of the correlations in a variance ratio, (ratios, lags); that over 2 blocks is the first lag's."""


class Standing(NamedTuple):
    """p: how often white noise would look at least as unlike white, at one moment; None while not known."""

    p: float | None
    whiteness: str | None


UNKNOWN = Standing(None, None)


class RunningNull:
    """The test of several axes that are sampled together.

    A lost sample takes the pairs and blocks that it belongs to with it; nothing is made up for it.
    """

    def __init__(self, axes: int) -> None:
        self.standings = (UNKNOWN,) * axes
        self._axes = axes
        self._waiting: list[Sequence[float]] = []
        self._missing = (math.nan,) * axes
        self._levels = [_Level(axes)]
        self._largest = [np.full(axes, np.nan)]

    def add(self, y: Sequence[float]) -> None:
        """Take one sample of every axis, in any unit; `standings` change with every 128th."""
        self._waiting.append(y)
        if len(self._waiting) == CHUNK:
            self.add_chunk(np.array(self._waiting))
            self._waiting = []

    def skip(self, count: int) -> None:
        """Take note of lost samples."""
        for row in repeat(self._missing, count):
            self.add(row)

    def add_chunk(self, values: Array) -> None:
        """Take `CHUNK` samples at once, (CHUNK, axes), NaN where lost; not between samples of `add`."""
        with np.errstate(over="ignore", invalid="ignore"):
            self._add(0, values)
            largest = self.largest()
        effective = EFFECTIVE * self.depth
        self.standings = tuple(_standing(value, effective) for value in largest.tolist())

    @property
    def depth(self) -> int:
        """Levels that have enough pairs to count; 0 before `FEWEST` samples."""
        if self._levels[0].count < FEWEST:
            return 0
        return sum(level.known for level in self._levels)

    def largest(self) -> Array:
        """The statistic of every axis; NaN where an axis never changed."""
        result: Array = np.fmax.reduce(self._largest, axis=0)
        return result

    def _add(self, place: int, values: Array) -> None:
        level = self._levels[place]
        centred = level.add(values)
        if level.known:
            self._largest[place] = level.largest()
        if place + 1 == LEVELS:
            return
        if place + 1 == len(self._levels):
            self._levels.append(_Level(self._axes))
            self._largest.append(np.full(self._axes, np.nan))
        above = self._levels[place + 1]
        above.waiting = np.concatenate((above.waiting, centred.reshape(-1, FACTOR, self._axes).sum(axis=1)))
        if len(above.waiting) == CHUNK:
            waiting, above.waiting = above.waiting, above.waiting[:0]
            self._add(place + 1, waiting)

    def save(self) -> bytes:
        """All of it, for `restore`."""
        first, *others = self._levels
        first.waiting = np.array(self._waiting, dtype=np.float64).reshape(-1, self._axes)
        numbers = np.concatenate([part for level in (first, *others) for part in level.parts()])
        return numbers.astype("<f8").tobytes()

    @classmethod
    def restore(cls, axes: int, data: bytes) -> "RunningNull":
        """Go on from what `save` returned; ValueError if that had other axes."""
        result = cls(axes)
        try:
            numbers = np.frombuffer(data, "<f8").astype(np.float64)
            levels = []
            while numbers.size:
                level, numbers = _Level.of_parts(axes, numbers)
                levels.append(level)
        except (ValueError, IndexError) as error:
            raise ValueError("its running test of whiteness cannot be read") from error
        if not 0 < len(levels) <= LEVELS:
            raise ValueError("its running test of whiteness has another form")
        result._levels = levels
        result._waiting = [tuple(row) for row in levels[0].waiting.tolist()]
        with np.errstate(over="ignore", invalid="ignore"):
            result._largest = [level.largest() if level.known else np.full(axes, np.nan) for level in levels]
            largest = result.largest()
        effective = EFFECTIVE * result.depth
        result.standings = tuple(_standing(value, effective) for value in largest.tolist())
        return result


class _Level:
    """Sums over pairs of blocks of one size, (lags, axes) or (axes,); NaN is a block that is not whole.

    The mean of the first values is taken off as they come, against rounding and because the standard
    deviations need it; what is left of the mean is taken out of the sums of products at the end.
    """

    def __init__(self, axes: int) -> None:
        self.waiting = np.empty((0, axes))
        self.count = 0
        self.pairs = np.zeros(LAGS)
        self._tail = np.full((LAGS, axes), np.nan)
        self._products = np.zeros((LAGS, axes))
        self._squares = np.zeros((LAGS, axes))
        self._both = np.zeros((LAGS, axes))
        self._sum = np.zeros(axes)
        self._sum_of_squares = np.zeros(axes)
        self._origin = np.full(axes, np.nan)

    @property
    def known(self) -> bool:
        """Whether there are enough pairs for the figures to be normal."""
        return bool(self.pairs[-1] >= FEWEST_PAIRS)

    def add(self, values: Array) -> Array:
        """Take `CHUNK` values, (CHUNK, axes); return them without their first mean."""
        if math.isnan(self._origin[0]):
            whole = values[~np.isnan(values[:, 0])]
            if not len(whole):
                return values
            self._origin = whole[0] + (whole - whole[0]).mean(axis=0)  # exact if they are all the same
        values = values - self._origin
        joined = np.concatenate((self._tail, values))
        self._tail = joined[CHUNK:]
        here = ~np.isnan(joined[:, 0])
        y = np.where(here[:, np.newaxis], joined, 0.0).T.copy()
        now = y[:, LAGS:]
        before = y[:, _BEFORE]
        present = here.astype(np.float64)
        present_before, present_now = present[_BEFORE], present[LAGS:]
        products = before * now[:, np.newaxis]
        self._products += products.sum(axis=2).T
        self._squares += np.einsum("akc,akc->ka", products, products)
        self._both += present_before @ now.T + (before @ present_now).T
        self.pairs += present_before @ present_now
        self.count += int(present_now.sum())
        self._sum += now.sum(axis=1)
        self._sum_of_squares += np.einsum("ac,ac->a", now, now)
        return values

    def largest(self) -> Array:
        """The largest magnitude of the normal figures of each axis; NaN where the values never change.

        Where values hardly ever change (a deviation of a fifth of an LSB) hardly any product is other than 0,
        and their own squares would say next to nothing of how they vary.
        """
        mean = self._sum / self.count
        variance = self._sum_of_squares / self.count - mean**2
        pairs = self.pairs[:, np.newaxis]
        products = self._products - mean * self._both + pairs * (mean**2 + variance / self.count)
        squares = np.maximum(self._squares, pairs * variance**2 / 2)
        single = products / np.sqrt(squares)
        ratios = (_RATIOS @ products) / np.sqrt(_RATIOS**2 @ squares)
        result: Array = np.maximum(np.abs(single).max(axis=0), np.abs(ratios).max(axis=0))
        return result

    def parts(self) -> Iterable[Array]:
        """All of it, as flat arrays; how many values wait stands first."""
        yield np.array([len(self.waiting), self.count], dtype=np.float64)
        for part in (self.waiting, self.pairs, *self._arrays()):
            yield part.ravel()

    @classmethod
    def of_parts(cls, axes: int, numbers: Array) -> tuple["_Level", Array]:
        """A level, and what stands behind it."""
        level = cls(axes)
        if not (0 <= numbers[0] < CHUNK and 0 <= numbers[1] < math.inf):
            raise ValueError("counts that cannot be")
        level.count = int(numbers[1])
        level.waiting = np.empty((int(numbers[0]), axes))
        numbers = numbers[2:]
        for part in (level.waiting, level.pairs, *level._arrays()):
            part[...] = numbers[: part.size].reshape(part.shape)
            numbers = numbers[part.size :]
        return level, numbers

    def _arrays(self) -> tuple[Array, ...]:
        sums = self._products, self._squares, self._both, self._sum, self._sum_of_squares
        return self._tail, *sums, self._origin


def p_value(largest: float, effective: int) -> float:
    """Probability that the largest magnitude of so many independent normal figures is no smaller."""
    single = math.erfc(largest / math.sqrt(2))
    return -math.expm1(effective * math.log1p(-single)) if single < 1 else 1.0


def _standing(largest: float, effective: int) -> Standing:
    if not effective or math.isnan(largest):
        return UNKNOWN
    p = float(f"{p_value(largest, effective):.3g}")
    return Standing(p, "rejected" if p < LEVEL else "not rejected")
