"""Play faults as `make faults` does. Each fault leads to the outcome that is stated with it, and every record
is accounted for.
"""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest

from tests.rig.tiers import long_but
from tests.rig.toolchain import missing, needed
from tools.faults.__main__ import PARTS
from tools.faults.case import Case, play, play_all
from tools.faults.daemon import lost_by_outputs
from tools.faults.expected import SOME, Expected
from tools.faults.outcome import LOST, Outcome
from tools.faults.program import Skip

AT_ONCE = {"daemon": 5, "fleet": 1, "ingest": 1}
"""For each part of the system whose faults are caused ("played") here: how many faults at the same time.

tests/e2e/test_due_faults.py plays the board's faults. Those of a cluster are in tests/cluster.
"""
SERVERS = {"fleet": ("mosquitto",), "ingest": ("nats-server", "mosquitto")}


class Fault(NamedTuple):
    """A fault and the part of the system that it concerns."""

    part: str
    case: Case


FAULTS = [Fault(part, case) for part in AT_ONCE for case in PARTS[part].cases if case.tested]
USUAL = {
    "daemon": "unplugged in mid-frame, back as another port",
    "fleet": "broker killed (`kill -9`) and started again",
    "ingest": "MQTT broker killed (`kill -9`), started again at once",
}
"""Maps each part of the fault tests to the one fault that the second tier of tests plays. `make faults` and
the third tier play all faults.
"""


Playing = Callable[[str], dict[str, "Future[Outcome]"]]


@pytest.fixture(scope="module")
def playing(request: pytest.FixtureRequest) -> Playing:
    """Return a function that starts those faults of a part of the system for which tests were selected. It
    returns the futures of their outcomes. Later calls for this part start nothing, and return the same.
    """
    parameters = (getattr(item, "callspec", None) for item in request.session.items)
    wanted = [one.params.get("fault") for one in parameters if one is not None]

    @cache
    def begin(part: str) -> dict[str, "Future[Outcome]"]:
        cases = [fault.case for fault in wanted if isinstance(fault, Fault) and fault.part == part]
        return play_all(cases, short=True, at_once=AT_ONCE[part])

    return begin


@pytest.mark.parametrize(
    "fault",
    long_but([fault for fault in FAULTS if fault.case.name == USUAL[fault.part]], FAULTS),
    ids=lambda fault: f"{fault.part}: {fault.case.name}",
)
def test_a_fault_leads_to_what_is_expected(fault: Fault, playing: Playing) -> None:
    for server in SERVERS.get(fault.part, ()):
        needed(server)
    try:
        outcome = playing(fault.part)[fault.case.name].result()
    except Skip as why:
        missing(str(why))
    assert (outcome.wrong, outcome.uncounted) == ([], 0)


# --- every fault has its expectation, and the expectation is compared ---


def test_every_fault_has_a_name_of_its_own_and_an_expectation() -> None:
    for part, (cases, _) in PARTS.items():
        names = [case.name for case in cases]
        assert len(set(names)) == len(names), part
        for case in cases:
            assert isinstance(case.expected, Expected), (part, case.name)


EXPECTED = Expected(("lost", "back"), due=(9, 11), lost=3, excused=(1, 2), figures={"bytes": SOME})
OUTCOME = Outcome(["lost", "back"], 10, {"delivered": 6, LOST: 3, "half": 1}, figures={"bytes": 5})


def played(outcome: Outcome, expected: Expected, **how: Any) -> Outcome:
    return play(Case("a fault", lambda stage: outcome, expected), **how)


def test_an_outcome_that_is_expected_is_right() -> None:
    assert played(OUTCOME, EXPECTED).is_right
    assert played(OUTCOME, Expected(("lost", "back"), lost=None, excused=None)).is_right


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"reported": ["back", "lost"]}, "reported back, lost, expected lost, back"),
        ({"reported": []}, "reported –, expected lost, back"),
        ({"due": 12}, "due: 12, expected (9, 11)"),
        ({"where": {"delivered": 7, LOST: 2, "half": 1}}, "counted as lost: 2, expected 3"),
        ({"where": {"delivered": 7, LOST: 3}}, "excused: 0, expected (1, 2)"),
        ({"where": {"delivered": 4, LOST: 3, "half": 2, "more": 1}}, "half + more: 3, expected (1, 2)"),
        ({"where": {"delivered": 0, LOST: 3, "half": 1}}, "no samples delivered"),
        ({"figures": {"bytes": 0}}, "bytes: 0, expected (1, inf)"),
        ({"figures": {}}, "bytes: None, expected (1, inf)"),
    ],
)
def test_an_outcome_that_is_not_expected_is_wrong(change: dict[str, Any], wrong: str) -> None:
    assert played(replace(OUTCOME, **change), EXPECTED).wrong == [wrong]


def test_numbers_of_records_are_not_compared_where_a_fault_lasts_minutes() -> None:
    longer = replace(OUTCOME, due=100, where={"delivered": 60, LOST: 30, "half": 10})
    assert played(longer, EXPECTED, short=False).is_right
    assert len(played(longer, EXPECTED, short=True).wrong) == 3
    assert len(played(replace(longer, reported=[]), EXPECTED, short=False).wrong) == 1


def test_kinds_in_any_order_and_kinds_that_depend_on_the_machine() -> None:
    expected = Expected(frozenset({"a", "b"}), perhaps=frozenset({"c"}), instead={"a": "d"})
    for reported in (["b", "a"], ["a", "c", "b", "a"], ["d", "b"]):
        assert expected.allows(reported), reported
    for reported in (["a"], ["a", "b", "e"], ["c"], []):
        assert not expected.allows(reported), reported


def test_an_output_that_loses_records_is_named() -> None:
    stats = {"outputs": {"stdout": {"dropped": 0}, "mqtt": {"dropped": 4}}}
    program: Any = SimpleNamespace(of=lambda kind: [stats])
    assert lost_by_outputs(program) == ["the output mqtt lost 4 records"]
    assert lost_by_outputs(program, but="mqtt") == []
