"""Every fault tells its owner what it is about and what to look at."""

import pytest
from fltea.wire.faults import fault_text
from fltea.wire.layout import FaultCode, Status
from host_support import ROOT

WORDS = {
    FaultCode.SENSOR_MISSING: (0x69, ["address 0x69", "3.3 V", "AD0", "pin 20", "pin 21"]),
    FaultCode.SENSOR_UNKNOWN: (0x12, ["WHO_AM_I is 0x12"]),
    FaultCode.READBACK_MISMATCH: (
        0x1B1800,
        ["register 0x1B of the sensor holds 0x00 in place of 0x18", "3.3 V"],
    ),
    FaultCode.BUS_HELD: (2, ["SCL stays low", "short"]),
    FaultCode.SENSOR_LOST: (3, ["3 errors in a row"]),
    FaultCode.SENSOR_FROZEN: (10, ["10 equal samples in a row", "3.3 V", "another one"]),
    FaultCode.DATA_READY_MISSING: (1_230_000, ["for 1.23 s", "INT to pin 2", "timer mode"]),
}


@pytest.mark.parametrize("code", FaultCode)
def test_text_of_a_fault(code: FaultCode) -> None:
    detail, words = WORDS[code]
    for word in words:
        assert word in fault_text(code, detail)


@pytest.mark.parametrize(
    ("detail", "lines"),
    [(1, "SDA stays low"), (2, "SCL stays low"), (3, "SDA and SCL stay low"), (9, "bus stays low")],
)
def test_which_line_is_held(detail: int, lines: str) -> None:
    assert lines in fault_text(FaultCode.BUS_HELD, detail)


def test_a_code_of_another_version_keeps_its_detail() -> None:
    assert "0xABC" in fault_text(99, 0xABC)


def test_the_firmware_page_lists_every_fault_and_counter() -> None:
    page = (ROOT / "firmware/README.md").read_text(encoding="utf-8")
    for code in FaultCode:
        assert f"| {code.value} `{code.name.lower()}` |" in page
    for counter in Status._fields:
        assert f"| `{counter}` |" in page
