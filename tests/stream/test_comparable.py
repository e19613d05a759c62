"""If a device's estimate is not compared with the host's, one reason is given: the first that applies."""

import itertools

import pytest
from fltea.records.estimate import DeviceAxisEstimate, WhyNot
from fltea.records.events import DeviceAxis
from fltea.records.why_not import WHY_NOT
from fltea.stream.board_compare import compare

from tests.rig.example_records import GOOD, INVALID

NUMBERS = {"alpha": 0.4, "alpha_std": 0.03, "f": -2.0, "f_std": 0.2, "state_dps": 0.1, "innovation_dps": 0.0}
OF_DEVICE = DeviceAxis(
    *(1, 0, "gyro_x", 9, 7),
    valid=True,
    constant=False,
    missing=False,
    skipped=False,
    tuned=False,
    **NUMBERS,
    interventions={},
)
FAULTS: dict[WhyNot, dict[str, object]] = {
    "device_not_valid": {"valid": False},
    "host_not_valid": {"known": INVALID},
    "other_start": {"host_age": 8},
    "device_skipped": {"skipped": True},
    "other_settings": {"same_settings": False},
}


def compared(**changes: object) -> DeviceAxisEstimate:
    facts = {"known": GOOD, "host_age": 7, "same_settings": True} | changes
    of_host = {name: facts.pop(name) for name in ("known", "host_age", "same_settings")}
    return compare(OF_DEVICE._replace(**facts), **of_host)


def test_two_of_the_same_steps_and_settings_are_comparable() -> None:
    found = compared()
    differences = found.alpha_difference, found.f_difference, found.state_difference
    assert differences == pytest.approx((0.4 - 0.412, -2 + 2.125, 0.1 - 0.1234))
    assert found.why_not is None


@pytest.mark.parametrize("first", FAULTS)
def test_the_first_reason_is_told(first: WhyNot) -> None:
    order = list(WHY_NOT)
    later = order[order.index(first) + 1 :]
    for n in range(len(later) + 1):
        for others in itertools.combinations(later, n):
            found = compared(**{name: one for why in (*others, first) for name, one in FAULTS[why].items()})
            assert (found.why_not, found.alpha_difference) == (first, None)


def test_a_board_that_uses_what_it_has_fitted_has_other_settings() -> None:
    assert compared(tuned=True).why_not == "other_settings"


@pytest.mark.parametrize("nothing", [{"host_age": None}, {"known": None}])
def test_a_host_that_has_no_estimate_yet_began_at_another_sample(nothing: dict[str, None]) -> None:
    assert compared(**nothing).why_not == "other_start"


def test_every_reason_has_words() -> None:
    assert set(WHY_NOT) == set(FAULTS)
