"""Convert the noise of an axis to figures for simple filters.

A simple filter has white noise, and either a random walk or one Gauss–Markov state. It has no states for the
relaxations (first-order Gauss-Markov processes) of the noise. With these figures, it still never predicts too
small an error of the heading.

A relaxation with standard deviation σ and correlation time τ has the density 2 σ² τ / (1 + ω² τ²) at the
frequency ω. At each frequency, white noise of density 2 σ² τ has at least this density. So has a random walk
with K² = 2 σ² / τ. So a filter with either of them in place of the relaxation predicts a heading error at
least as large as the true one. Of the two, the one that predicts the smaller error is chosen. After a time T,
that is white noise if τ < T / √3, else the random walk.
"""

import math
from collections.abc import Sequence

from fltea.documents.imu_yaml import Shown
from fltea.documents.programs import FilterFigures
from fltea.identification.axis_report import AxisReport
from fltea.identification.kalibr import axis_noise
from fltea.identification.navigation_filter import FilterState, NavigationFilter
from fltea.records.verdict_kinds import VerdictKind
from fltea.spectrum.allan_coefficients import Coefficient
from fltea.spectrum.wording import duration, listed

LONG_S = 4 * 3600.0
"""The correlation time of a Gauss–Markov state that replaces a random walk [s].

This time is much longer than a filter runs without new samples at rest.
"""
NEGLIGIBLE = 0.1
"""The random walk for a simple filter consists of the axis's own random walk and of its slow relaxations. The
own random walk is negligible if its K is less than this fraction of the K of all together.
"""
WITHOUT_SLOW: tuple[VerdictKind, ...] = ("white", "line", "resonance", "line or resonance", "comb")
"""Verdicts on noise that has no slow component."""
UP_TO_S = 60.0
"""Default of `up_to_s` in `filter_figures`, the time for which the figures are chosen [s]."""


def filter_figures(axis: AxisReport, up_to_s: float = UP_TO_S) -> FilterFigures:
    """Return N, K and other figures of the axis for a filter without states for relaxations.

    `up_to_s`: time for which the figures are chosen [s]. After it, the predicted heading error is as little
    above the true one as such figures allow.
    """
    base, plain = axis_noise(axis), axis.filter
    N, K, said, tau_s = base.N._replace(slower=()), base.K, "", LONG_S
    if plain is not None and plain.gauss_markov and not _is_unlearnt(axis, base.K):
        fast = [one for one in plain.gauss_markov if one.tau_s < up_to_s / math.sqrt(3)]
        slow = [one for one in plain.gauss_markov if one not in fast]
        white = math.hypot(max(base.N.value or 0.0, plain.N), *map(_as_white, fast))
        N = Shown(white, f"with {_named(fast)} as white noise" if fast else base.N.remark)
        walk = math.hypot(plain.K, *map(_as_walk, slow))
        if slow or walk > 0:
            K = Shown(walk, f"{_named(slow)} as a walk" if slow else "")
        said = _said(plain, fast, slow, (N.value or plain.N, walk), up_to_s)
        if slow and NEGLIGIBLE * walk > plain.K:
            tau_s = max(one.tau_s for one in slow)
    return FilterFigures(
        N, K, _time(K, tau_s), _instability(None if axis.allan is None else axis.allan.B), said
    )


def _is_unlearnt(axis: AxisReport, K: Shown) -> bool:
    """Whether the recording shows neither a random walk nor other slow noise.

    A filter still has states for slow noise that may be too weak to be seen. In that case they are ignored,
    and the upper bound of K is shown.
    """
    return K.value is None and axis.result.verdict.kind in WITHOUT_SLOW


def _as_white(state: FilterState) -> float:
    return state.sigma * math.sqrt(2 * state.tau_s)


def _as_walk(state: FilterState) -> float:
    return state.sigma * math.sqrt(2 / state.tau_s)


def _named(states: Sequence[FilterState]) -> str:
    times = listed([duration(one.tau_s) for one in sorted(states, key=lambda one: one.tau_s)])
    return f"{'relaxations' if len(states) > 1 else 'a relaxation'} of {times}"


def _said(
    plain: NavigationFilter,
    fast: Sequence[FilterState],
    slow: Sequence[FilterState],
    as_written: tuple[float, float],
    t_s: float,
) -> str:
    """Return a text that says which relaxations are included in N or K, and how much larger the error gets.

    `as_written`: N and K with the relaxations. `t_s`: time after which the heading's errors are compared [s].
    """
    (N, K), own = as_written, plain.N**2 * t_s + plain.K**2 * t_s**3 / 3
    for state in (*fast, *slow):
        over = t_s / state.tau_s
        # `grown`: factor in the variance that this relaxation adds to the heading in `t_s`, if its value is
        # known at the beginning
        grown = 2 * over - 3 + 4 * math.exp(-over) - math.exp(-2 * over)
        own += (state.sigma * state.tau_s) ** 2 * grown
    ratio = math.sqrt((N**2 * t_s + K**2 * t_s**3 / 3) / own)
    forms = [
        f"{_named(part)} {'counts' if len(part) == 1 else 'count'} as {what}"
        for part, what in ((fast, "white noise"), (slow, "a walk"))
        if part
    ]
    more = "about" if ratio < 1.05 else f"{ratio:.2g} times"
    return (
        f"{' and '.join(forms)}, since these settings have no terms for relaxations. This does not "
        f"underestimate the heading's error: after {duration(t_s)} these figures predict {more} the error of "
        "the complete noise model."
    )


def _time(K: Shown, tau_s: float) -> Shown:
    if K.value is None:
        return Shown(None, "K is not known, and this is the correlation time of a state in place of it")
    return Shown(tau_s, "so long that the state acts as a random walk" if tau_s == LONG_S else "")


def _instability(B: Coefficient | None) -> Shown:
    if B is None:
        return Shown(None, "there is no Allan deviation")
    return Shown(B.value, "" if B.value is not None else B.reason, B.at_most if B.value is None else None)
