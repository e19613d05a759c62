"""Tests that the table of chips is complete.

If a new chip lacks something, the failure names it, and the file in which it belongs.

`test_i2c_driver.py` and `test_chip_runs.py` check that the driver reads each chip as its data sheet says.
"""

import importlib

import numpy as np
import pytest
from fltea.sources.i2c import texts
from fltea.sources.i2c.chips import ADDRESSES, CHIPS, chip_of
from fltea.sources.i2c.source import POLL_S
from fltea.wire.layout import FaultCode
from fltea.wire.sensors import SENSORS, temperature_c

from tests.rig.emulated_chips import EMULATED, FIRST
from tests.rig.host_support import ROOT
from tools import site_chips

FOLDER = ROOT / "host/fltea/sources/i2c"


def test_every_module_of_a_family_is_in_the_table() -> None:
    files = [file for file in FOLDER.glob("*.py") if "\nFAMILY = " in file.read_text(encoding="utf-8")]
    for file in files:
        family = importlib.import_module(f"fltea.sources.i2c.{file.stem}").FAMILY
        assert family is CHIPS.get(family.name), f"sources/i2c/chips.py: CHIPS has no FAMILY of {file.name}"
    assert len(files) == len(CHIPS) > 1


def test_every_sensor_has_a_family_and_every_family_a_sensor() -> None:
    unknown = {one.name: one.family for one in SENSORS.values() if one.family not in CHIPS}
    assert not unknown, f"sources/i2c/chips.py: CHIPS has no family for {unknown}"
    empty = CHIPS.keys() - {one.family for one in SENSORS.values()}
    assert not empty, f"wire/sensors.py: SENSORS has no WHO_AM_I of {empty}"


def test_every_sensor_has_an_emulated_twin() -> None:
    missing = [one.name for who_am_i, one in SENSORS.items() if who_am_i not in EMULATED]
    assert not missing, f"tests/rig/emulated_chips.py: EMULATED has no {missing}"
    assert {who: one.name for who, one in SENSORS.items()} == {who: one.name for who, one in EMULATED.items()}


def test_every_thermometer_has_its_scale() -> None:
    for who_am_i, facts in EMULATED.items():
        for counts, celsius in ((facts.at_25_c, 25.0), (facts.at_25_c + round(10 * facts.counts_a_c), 35.0)):
            found = float(temperature_c(np.array([counts], np.int16), who_am_i)[0])
            assert found == pytest.approx(celsius, abs=0.01), f"wire/sensors.py: SENSORS, {facts.name}"


def test_the_fifo_of_every_chip_outlasts_two_polls() -> None:
    for who_am_i, sensor in SENSORS.items():
        where = f"sources/i2c, {sensor.name}: fifo_bytes, or packet"
        assert chip_of(who_am_i).fifo_s > 2 * max(POLL_S), where


FACTS = ("banks", "gyro_range_dps", "gyro_lsb_per_dps", "gyro_ends", "gyro_dlpf_hz", "accel_range_g",
         "accel_lsb_per_g", "keeps_oldest")  # fmt: skip
"""Facts of a chip that stand in the driver's table and, typed by hand, in `EMULATED`."""


@pytest.mark.parametrize("who_am_i", EMULATED, ids=lambda who_am_i: EMULATED[who_am_i].name)
def test_the_facts_of_every_chip(who_am_i: int) -> None:
    chip, facts = chip_of(who_am_i), EMULATED[who_am_i]
    for name in FACTS:
        found, true = getattr(chip, name), getattr(facts, name)
        assert found == true, facts.row(f"{name} is {found}, not {true}")
    assert chip.rate_hz == 1000 / facts.period_ms, facts.row("rate_hz")
    assert chip.fifo_samples == facts.holds, facts.row("fifo_bytes, or packet")
    assert 1000 * chip.reset_s >= facts.reset_ms, facts.row("reset_s is too short")
    modelled_ms = facts.model.gyro_start_ns / 1e6
    assert modelled_ms >= facts.gyro_start_ms, f"tools/due_emulator, {facts.name}: gyro_start_ns"
    assert 1000 * chip.settle_s >= facts.gyro_start_ms, facts.row("settle_s is too short")
    from_fifo, from_register = chip.packet.temperature is not None, chip.temperature is not None
    assert from_fifo != from_register, facts.row("temperature or packet.temperature: one of both is needed")
    # If the driver allows for too small an error, it takes the error of a correct clock for lost samples. If
    # it allows for more than four times the stated error, it would not notice lost samples.
    assert facts.clock_error <= chip.clock_error <= 4 * facts.clock_error, facts.row("clock_error")


def test_texts_name_every_chip_and_every_address() -> None:
    unknown = texts.fault_text(FaultCode.SENSOR_UNKNOWN, 0x12, "/dev/i2c-1", 0x68)
    missing = texts.fault_text(FaultCode.SENSOR_MISSING, 0, "/dev/i2c-1", 0x68)
    for who_am_i, sensor in SENSORS.items():
        assert sensor.is_clone or sensor.name in unknown
        assert (chip_of(who_am_i).banks is None) == (f"&chip={sensor.family}'" not in unknown)
    for address, how in ADDRESSES.items():
        assert f"0x{address:02X} with {how}" in missing


def test_the_guide_and_a_readme_name_a_chip_of_every_family() -> None:
    page = (ROOT / "host/docs/guide/raspberry_pi.md").read_text(encoding="utf-8")
    sources = (ROOT / "host/docs/guide/sources.md").read_text(encoding="utf-8")
    (row,) = [line for line in sources.splitlines() if line.startswith("| `i2c:")]
    for who_am_i in FIRST.values():
        name = SENSORS[who_am_i].name
        assert name in page.partition("![")[0], f"guide/raspberry_pi.md: the introduction has no {name}"
        assert name in row, f"guide/sources.md: the row of i2c: has no {name}"
        module = EMULATED[who_am_i].model.__module__.rpartition(".")[2]
        readme = (ROOT / "tools/due_emulator/README.md").read_text(encoding="utf-8")
        assert f"`{module}" in readme, f"tools/due_emulator/README.md: the table has no {module}"


def test_the_guide_says_which_addresses_a_chip_has() -> None:
    page = (ROOT / "host/docs/guide/sources.md").read_text(encoding="utf-8")
    (row,) = [line for line in page.splitlines() if line.startswith("| `i2c:")]
    for address in ADDRESSES:
        assert f"0x{address:02X}" in row, f"guide/sources.md: the row of i2c: has no 0x{address:02X}"


def test_the_page_has_a_row_for_every_chip() -> None:
    table = site_chips.chips()
    for who_am_i, sensor in SENSORS.items():
        facts = EMULATED[who_am_i]
        (row,) = [line for line in table.splitlines() if f"| `0x{who_am_i:02X}` |" in line]
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        assert cells[0] == sensor.name
        assert cells[2] == f"`{sensor.family}`"
        assert cells[3] == f"{1000 / facts.period_ms:g} Hz"
        assert cells[-1] == f"{facts.holds} samples, {facts.holds * facts.period_ms / 1000:.2g} s"
    page = (ROOT / "host/docs/guide/raspberry_pi.md").read_text(encoding="utf-8")
    assert "\n<!-- generated: chips -->\n" in page
