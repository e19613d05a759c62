"""Test of the emulated Due while it is turned about one axis: its estimates for the other axes stay right.

Computing the estimates takes no more time than allowed.
"""

import pytest
from fltea.sources.synthetic import parse_noise
from fltea.wire import layout as wire

from tests.rig.due_support import NOISE, DueRun, image
from tools.due_emulator.noise import Fractional, Vector

TURNS_S, ENDS_S, END_S = 30.0, 35.0, 38.0
RATE_HZ = 100


class Turned(Fractional):
    """A sensor that is turned by 20 deg/s about z. Half a per cent of that rate also appears on the axes x
    and y.
    """

    def next_rate(self, k: int) -> Vector:
        x, y, z = super().next_rate(k)
        turns = TURNS_S <= k / RATE_HZ < ENDS_S
        return (x + 0.1, y + 0.1, z + 20.0) if turns else (x, y, z)


@pytest.mark.slow
def test_a_turn_about_z_leaves_the_bias_of_x_as_it_was() -> None:
    run = DueRun(image(), world=Turned(parse_noise(NOISE))).run_until(END_S)
    assert run.check() is None
    assert (run.stats.sample_counts.lost, run.gaps, run.troubles) == (0, [], [])
    (fit,) = (arrival.frame.message for arrival in run.of(wire.Fit))
    assert (fit.axis, fit.verdict) == (wire.Axis.GYRO_X, 1)
    tracked = [
        (arrival.at_s, arrival.frame.message.tracker_bias)
        for arrival in run.of(wire.Estimate)
        if arrival.frame.message.flags & wire.EstimateFlags.TRACKED
    ]
    before = [bias for at_s, bias in tracked if at_s < TURNS_S][-1]
    during = [bias for at_s, bias in tracked if TURNS_S + 0.7 < at_s < ENDS_S]
    assert len(during) > 40
    # During the turn, the bias stays the mean of the samples at rest, without the newest of them, which may
    # belong to the turn.
    assert len(set(during)) == 1
    assert during[0] == pytest.approx(before, abs=0.003)
    after = [bias for at_s, bias in tracked if at_s > ENDS_S + 1]
    assert after == pytest.approx([during[0]] * len(after), abs=0.003)
    assert len(after) > 10
    shares = [arrival.frame.message.cpu_share for arrival in run.of(wire.Status) if arrival.at_s > 17]
    assert all(2000 < share < 2450 for share in shares)
    assert run.of(wire.Estimator)[-1].frame.message.skipped == 0
