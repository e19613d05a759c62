"""Tests the statistics of many devices. Each device's statistics are published once a second. If there are
many devices, their statistics come at different moments of the second.
"""

from itertools import pairwise

import pytest
from fltea.records.records import Stats
from fltea.stream.fit_worker import FitWorker
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.blocks import cuts, in_blocks, ndjson, of
from tests.rig.device_stream_support import raw, run_pipeline
from tests.rig.host_support import hello

SECOND_NS, PERIOD_NS = 10**9, 10**7


def times_ns(devices: int, number: int) -> list[int]:
    items, _ = run_pipeline([hello(), raw(range(450))], fit_worker=FitWorker(devices), number=number)
    return [one.host_ns for one in of(Stats, items)]


def test_many_devices_have_turns_within_the_second() -> None:
    found = [times_ns(24, number) for number in range(24)]
    for times in found:
        assert [b - a for a, b in pairwise(times)] == [SECOND_NS] * (len(times) - 1)
    phases = sorted(times[0] % SECOND_NS for times in found)
    assert max(b - a for a, b in pairwise([*phases, phases[0] + SECOND_NS])) <= SECOND_NS // 10
    assert found[0][0] % SECOND_NS < PERIOD_NS


def test_of_few_devices_all_come_with_the_second() -> None:
    assert times_ns(12, 11) == times_ns(1, 0)


@pytest.mark.slow
@given(cuts(450), st.integers(0, 30))
@settings(max_examples=25, deadline=None)
def test_they_do_not_depend_on_how_samples_were_put_together(places: list[int], number: int) -> None:
    block = raw(range(450))
    whole, _ = run_pipeline([hello(), block], fit_worker=FitWorker(31), number=number)
    cut, _ = run_pipeline([hello(), *in_blocks(block, places)], fit_worker=FitWorker(31), number=number)
    assert ndjson(cut) == ndjson(whole)
