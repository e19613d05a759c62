"""Convert the noise of an axis to the figures of Kalibr's imu.yaml."""

import math

from fltea.documents.imu_yaml import AxisNoise, Shown
from fltea.identification.axis_report import AxisReport
from fltea.identification.navigation_filter import NavigationFilter, slope_of
from fltea.identification.tracked_system import OffsetWalkFound
from fltea.noise.linear_system import System
from fltea.spectrum.wording import duration

NO_FILTER = "no filter works with this noise, so its random walk is not known"
CONSTANT = "the offset is as good as constant here; with a record ten times as long the bound is a tenth"
NOT_TOLD = "the record is too short to tell a random walk from a constant offset"
TAKEN_OUT = "a high-pass has removed the walk (AC coupling, an auto-zero): the sensor itself may have one"
MATTERS, MOST = 1.1, 3
"""A Gauss–Markov state adds to the noise density at times longer than its correlation time. A comment in
imu.yaml lists this density only if it exceeds that without the state by more than the factor MATTERS. At most
MOST states are listed.
"""


def axis_noise(axis: AxisReport) -> AxisNoise:
    """Return N and K of an axis for imu.yaml.

    N is that of the white noise. If white noise cannot be told from other fast noise, N is that of the filter
    of `--gauss-markov`. K is given only if the offset follows a random walk, and then it is that of this
    walk. If the offset also has a slope, the filter of `--gauss-markov` has a random walk in its place. K is
    then at least that of this filter.
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
        # `plain` is the filter of --gauss-markov, which replaces a slope by a random walk. So its K is used
        # only if there is a slope. Otherwise its K may be too small, since it describes a bounded walk by a
        # Gauss–Markov state. imu.yaml has no such state.
        K = walk.K.value or 0.0
        return Shown(max(plain.K, K) if slope_of(tracked).any() else K)
    if walk.said == "likely constant":
        return Shown(None, CONSTANT, walk.at_most)
    if walk.said == "taken out":
        return Shown(None, TAKEN_OUT)
    longer = "" if walk.tells_s is None else f", about {duration(walk.tells_s)} would"
    return Shown(None, f"{NOT_TOLD}{longer}", walk.at_most)


def _slower(N: float, plain: NavigationFilter) -> tuple[tuple[float, float], ...]:
    """Return pairs: the correlation time of a Gauss–Markov state, and the noise density over longer times.

    This density is that of the white noise, of the state and of all faster states. Only states that raise the
    density are listed, the fastest first.
    """
    total, found = max(N, plain.N) ** 2, []
    for state in reversed(plain.gauss_markov):
        before, total = total, total + 2 * state.sigma**2 * state.tau_s
        if total > MATTERS**2 * before:
            found.append((state.tau_s, math.sqrt(total)))
    return tuple(found[:MOST])
