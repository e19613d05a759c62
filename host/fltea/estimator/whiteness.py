"""Whether the innovations of a filter are white, and as large as it thinks (pure).

Of a filter whose model is right the innovations are uncorrelated, and their squares over the variance that it
predicts have the mean 1 (Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and
Navigation*, section 5.4.2).
"""

from collections import deque

BLOCK = 100
BLOCKS = 10
FEWEST = 200


class Whiteness:
    """Both figures over the last `BLOCK * BLOCKS` innovations, give or take a block; None before `FEWEST`."""

    def __init__(self) -> None:
        self._blocks: deque[tuple[int, float, float, float]] = deque(maxlen=BLOCKS - 1)
        self._now = (0, 0.0, 0.0, 0.0)
        self._last: float | None = None

    def add(self, innovation: float, std: float) -> None:
        """Take an innovation and the standard deviation that the filter gave it, in the same unit."""
        n, products, squares, normalised = self._now
        if self._last is not None:
            products += innovation * self._last
        self._last = innovation
        if std > 0:
            normalised += (innovation / std) ** 2
        self._now = (n + 1, products, squares + innovation * innovation, normalised)
        if n + 1 == BLOCK:
            self._blocks.append(self._now)
            self._now = (0, 0.0, 0.0, 0.0)

    def skip(self) -> None:
        """Take note that there was no innovation: what follows has no neighbour."""
        self._last = None

    @property
    def lag1(self) -> float | None:
        """Correlation of neighbours, 0 ± 1/√n for white innovations."""
        n, products, squares, _ = self._sums()
        return products / squares if n >= FEWEST and squares > 0 else None

    @property
    def nis(self) -> float | None:
        """Mean normalised innovation squared; 1 where the filter's variance is right."""
        n, _, _, normalised = self._sums()
        return normalised / n if n >= FEWEST else None

    def _sums(self) -> tuple[float, ...]:
        return tuple(sum(column) for column in zip(*self._blocks, self._now, strict=True))
