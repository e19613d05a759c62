"""Fits that begin at the last answers, for one axis that is fitted again and again."""

from collections.abc import Callable
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from fltea.spectrum.periodogram import Binned
from fltea.spectrum.whittle import Fit, Held, Model, fit

Array = NDArray[np.float64]
T = TypeVar("T")

AGAIN = 2.0
"""Growth of the record after which the grid of starts is searched again."""
AGAIN_ON_BOUND = 1.1
"""The same growth for an answer at the edge of what is possible."""
LOOK_AGAIN = 1.1
"""The growth after which peaks and changes are looked for again; the fits themselves are made every time."""
EDGE = 13.0
"""The coordinate beyond which a share is below 2e-6, and the likelihood is flat."""


class Search(Protocol):
    """How a model is fitted: `whittle.fit`, or one that remembers."""

    def __call__(self, data: Binned, model: Model, extra_starts: Array | None = None) -> Fit:
        """Fit `model` to every series of `data`; extra_starts: (series, k, p)."""
        ...


class Warm:
    """The last answers of one axis, by set of ordinates and model."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, str, float, Held], tuple[Array, float]] = {}
        self.ends: Array | None = None
        """The ends of the intervals, as `profile.fractional_fit` keeps them."""
        self._looked: dict[str, tuple[Any, float]] = {}

    def forget(self) -> None:
        """Begin on the grid again."""
        self._last.clear()
        self._looked.clear()
        self.ends = None

    def looked(self, name: str, ordinates: float, look: Callable[[], T]) -> T:
        """Return what `look` found last under this name, or finds now if the record has grown too far."""
        found, then = self._looked.get(name, (None, 0.0))
        if ordinates > LOOK_AGAIN * then:
            found, then = self._looked[name] = look(), ordinates
        return cast(T, found)

    def of(self, name: str) -> Search:
        """Return the fits to the ordinates that are called `name`."""

        def search(data: Binned, model: Model, extra_starts: Array | None = None) -> Fit:
            key = name, model.name, model.highest_order, model.held
            theta, fitted_at = self._last.get(key, (None, 0.0))
            ordinates = float(data.counts.sum())
            if theta is not None:
                on_bound = bool((np.abs(theta) > EDGE).any())
                if ordinates > fitted_at * (AGAIN_ON_BOUND if on_bound else AGAIN):
                    theta = None
            if theta is None:
                fitted_at = ordinates
            found = fit(data, model, extra_starts, warm=theta)
            self._last[key] = found.theta, fitted_at
            return found

        return search
