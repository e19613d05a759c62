"""Why a device's estimate says nothing beside the host's: one reason, the first that applies."""

import itertools

import pytest
from fltea.records.records import WhyNot
from fltea.records.why_not import WHY_NOT
from fltea.stream.board_compare import why_not_comparable

SAME = {
    "device_valid": True,
    "host_valid": True,
    "device_age": 7,
    "host_age": 7,
    "device_skipped": False,
    "same_settings": True,
}
FAULTS: dict[WhyNot, dict[str, object]] = {
    "device_not_valid": {"device_valid": False},
    "host_not_valid": {"host_valid": False},
    "other_start": {"host_age": 8},
    "device_skipped": {"device_skipped": True},
    "other_settings": {"same_settings": False},
}


def test_two_of_the_same_steps_and_settings_are_comparable() -> None:
    assert why_not_comparable(**SAME) is None


@pytest.mark.parametrize("first", FAULTS)
def test_the_first_reason_is_told(first: WhyNot) -> None:
    order = list(WHY_NOT)
    later = order[order.index(first) + 1 :]
    for others in itertools.chain.from_iterable(
        itertools.combinations(later, n) for n in range(len(later) + 1)
    ):
        facts = SAME.copy()
        for fault in (*reversed(others), first):
            facts |= FAULTS[fault]
        assert why_not_comparable(**facts) == first


def test_a_host_that_has_no_estimate_yet_began_at_another_sample() -> None:
    assert why_not_comparable(**(SAME | {"host_valid": None, "host_age": 0})) == "other_start"


def test_every_reason_has_words() -> None:
    assert set(WHY_NOT) == set(FAULTS)
