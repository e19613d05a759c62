"""A line that gets stuck at any phase of a transfer: the board frees it, and loses two samples at most."""

from functools import cache

import pytest
from due_support import NOISE, DueRun, image

BIT_S = 2.5e-6
BYTES = 14
# In bits from the START: address, register, repeated START, address, each byte, STOP.
PHASES = {
    "address": 5.0,
    "register": 14.0,
    "repeated start": 19.4,
    "address to read": 24.0,
    **{f"byte {i}": 29.0 + 9 * i + 4 for i in range(BYTES)},
    "acknowledge": 29.0 + 8.4,
    "last acknowledge": 29.0 + 9 * BYTES - 0.6,
    "stop": 29.0 + 9 * BYTES + 0.4,
}
STUCK = {
    # It lets go after as many clocks as a sensor in mid-byte may need.
    "SDA": "sda_stuck at={at:.7f} clocks=9",
    "SCL": "scl_stuck at={at:.7f} for=0.004",
}


@cache
def start_s() -> float:
    """When a transfer of a sample begins, in a quiet run."""
    run = DueRun(image(), noise=NOISE).run_until(0.3)
    return next(burst.at_ps * 1e-12 for burst in run.boots[0].bursts if burst.at_ps > 0.25e12)


@pytest.mark.slow
@pytest.mark.parametrize("line", STUCK)
@pytest.mark.parametrize("phase", PHASES)
def test_a_line_that_gets_stuck_costs_two_samples_at_most(phase: str, line: str) -> None:
    fault = STUCK[line].format(at=start_s() + PHASES[phase] * BIT_S)
    run = DueRun(image(), noise=NOISE, faults=[fault]).run_until(0.65)
    assert run.check() is None
    assert len(run.boots) == 1
    assert run.epochs == ["start"], "the sensor was not set up again"
    assert run.stats.samples.lost <= 2
    newest = run.samples[-1]
    assert newest.seq * 0.01 > 0.65 - start_s(), "it goes on"
    assert newest.flags == 0
    assert run.status is not None
    assert run.status.i2c_errors > 0
