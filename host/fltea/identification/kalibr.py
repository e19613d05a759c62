"""What Kalibr's imu.yaml has of an axis, by its tracked system."""

import math

from fltea.documents.imu_yaml import AxisNoise, Shown
from fltea.identification.axis_report import AxisReport
from fltea.identification.navigation_filter import NavigationFilter, slope_of
from fltea.identification.tracked_system import OffsetWalkFound
from fltea.noise.system import System
from fltea.spectrum.wording import duration

NO_FILTER = "no filter can work with this noise, so its walk is not known"
CONSTANT = "the offset is as good as constant here, and a record ten times as long tells a tenth of the bound"
NOT_TOLD = "the record is too short to tell a walk from a constant offset"
TAKEN_OUT = "a high-pass has taken the walk out (AC coupling, an auto-zero): the sensor may well have one"
MATTERS, MOST = 1.1, 3
"""The density grows by this ratio at a correlation time that is told, and how many are told."""


def axis_noise(axis: AxisReport) -> AxisNoise:
    """Return N and K of an axis.

    Where the offset walks, K is that of the walk, or of the filter of `--gauss-markov` where a slope makes it
    larger. N is that of the white noise, or of the filter where white noise cannot be told from what else is
    fast.
    """
    level, plain, tracked = axis.result.level, axis.filter, axis.tracked
    if plain is None or axis.walk is None or tracked is None:
        return AxisNoise(Shown(level.N.value, level.reason), Shown(level.K.value, NO_FILTER))
    N, remark = level.N.value, ""
    if N is None:
        N = plain.N
        remark = "of white noise and what cannot be told from it"
    return AxisNoise(Shown(N, remark, slower=_slower(N, plain)), _walk(axis.walk, plain, tracked.system))


def _walk(walk: OffsetWalkFound, plain: NavigationFilter, tracked: System) -> Shown:
    if walk.said == "walks":
        # A filter has a walk within bounds as a state, which imu.yaml has not; it has a slope as a walk.
        K = walk.K.value or 0.0
        return Shown(max(plain.K, K) if slope_of(tracked).any() else K)
    if walk.said == "likely constant":
        return Shown(None, CONSTANT, walk.at_most)
    if walk.said == "taken out":
        return Shown(None, TAKEN_OUT)
    longer = "" if walk.tells_s is None else f", about {duration(walk.tells_s)} would"
    return Shown(None, f"{NOT_TOLD}{longer}", walk.at_most)


def _slower(N: float, plain: NavigationFilter) -> tuple[tuple[float, float], ...]:
    """Return correlation times at which the density is larger than what is faster has together."""
    total, found = max(N, plain.N) ** 2, []
    for state in reversed(plain.gauss_markov):
        before, total = total, total + 2 * state.sigma**2 * state.tau_s
        if total > MATTERS**2 * before:
            found.append((state.tau_s, math.sqrt(total)))
    return tuple(found[:MOST])
