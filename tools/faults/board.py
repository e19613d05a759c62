"""Faults of sensor, bus, line and board on the emulated Due, as `tools.fault_report` plays them."""

from collections.abc import Iterator

from tools import fault_report
from tools.due_emulator.__main__ import IMAGE
from tools.due_emulator.image import read_image
from tools.faults.row import Row

PART = "board"


def rows(words: list[str]) -> Iterator[Row]:
    """One of each case."""
    image = read_image(IMAGE).content
    for case in fault_report.CASES:
        if words and not any(word in case.name for word in words):
            continue
        _, one = fault_report.measure(image, case)
        where = {
            "delivered": one.delivered,
            "counted as lost": one.lost,
            "unheard when a boot ended": one.unheard,
        }
        again = f"at most {one.recovery_s:.2f} s from sample to sample"
        wrong = [one.wrong] if one.wrong else []
        yield Row(PART, one.name, [*one.faults, *one.epochs], "samples", one.due, where, again, wrong)
