"""The program or the bus is delayed while the FIFO is restarted after a broken transfer.

Each sample is either delivered with its true number, or counted as lost. If the number of lost samples is not
certain, the report says how uncertain it is.
"""

import errno
import re

import pytest
from smbus2 import i2c_msg

from tests.rig.fake_smbus import Pi, S, taken_ns

SETTLED_S = 13
"""The sensor's clock has settled by this time."""
TRANSFERS = range(12)
"""Transfers after the broken one: six that restart the FIFO, and those of the first poll after it."""


def delayed(transfer: int, delay_s: float) -> Pi:
    """Return a Pi on which a transfer of samples broke off. The program was delayed a little later.

    `transfer`: the transfer after which the delay came; 0 is the first one after the broken transfer.
    """
    pi = Pi()
    seen: list[int] = []

    def inject(messages: tuple[i2c_msg, ...]) -> int | None:
        if pi.host.now_ns < SETTLED_S * S:
            return None
        register = bytes(messages[0])[0]
        if not seen:
            if register != 0x74:
                return None
            seen.append(register)
            return errno.EIO
        seen.append(register)
        if len(seen) == transfer + 2:
            pi.host.stall(pi.host.now_ns + 1, round(delay_s * S))
        return None

    pi.bus.inject = inject
    return pi.run_until(SETTLED_S + 4)


@pytest.mark.parametrize("delay_s", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("transfer", [4, 5])
def test_a_delay_while_the_fifo_is_restarted_does_not_change_numbers(transfer: int, delay_s: float) -> None:
    """The FIFO fills from the write that starts it, so delays of later transfers lose no further samples."""
    pi = delayed(transfer, delay_s)
    pi.check()
    assert pi.missing == [3]
    assert pi.told == ["fifo_restarted"]


@pytest.mark.parametrize("transfer", TRANSFERS)
def test_a_long_delay_is_counted_as_exactly_as_is_said(transfer: int) -> None:
    """During the delay the FIFO runs over. The count of lost samples differs from the truth by at most what
    the reports state.
    """
    pi = delayed(transfer, 1.1)
    times = [taken_ns(raw.gyro, raw.accel) for raw in pi.raw]
    true = round((times[-1] - times[0]) / (S / pi.hello.rate_hz)) + 1 - len(times)
    uncertain = sum(int(number) for number in re.findall(r"± (\d+) samples", pi.texts))
    assert abs(sum(pi.missing) - true) <= uncertain, (pi.missing, true, pi.texts)
