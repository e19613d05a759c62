"""Tests of the texts for people about sensor chips and faults."""

import pytest
from fltea.wire.faults import fault_text
from fltea.wire.layout import FaultCode, Status
from fltea.wire.sensors import sensor_name, temperature_c

from tests.rig.emulated_chips import EMULATED
from tests.rig.host_support import ROOT


@pytest.mark.parametrize(
    ("who_am_i", "name"),
    [
        *((who_am_i, facts.name) for who_am_i, facts in EMULATED.items()),
        (0xFF, "unknown sensor (WHO_AM_I 0xFF)"),
        (0x0A, "unknown sensor (WHO_AM_I 0x0A)"),
        (0, "no sensor"),
    ],
)
def test_name_of_a_chip(who_am_i: int, name: str) -> None:
    assert sensor_name(who_am_i) == name


@pytest.mark.parametrize(("counts", "celsius"), [(0, 21.0), (33387, 121.0), (-3339, 10.999), (1336, 25.0016)])
@pytest.mark.parametrize("who_am_i", [0x71, 0x73, 0x70, 0x75, 0x78, None])
def test_thermometer_of_the_9250(who_am_i: int | None, counts: int, celsius: float) -> None:
    assert temperature_c(counts, who_am_i) == pytest.approx(celsius, abs=5e-4)


@pytest.mark.parametrize(("counts", "celsius"), [(0, 36.53), (3400, 46.53), (-12420, 0.0006)])
def test_thermometer_of_the_6050(counts: int, celsius: float) -> None:
    assert temperature_c(counts, 0x68) == pytest.approx(celsius, abs=5e-4)


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
