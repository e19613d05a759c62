"""Tests of what can be a serial port, by the kernel's list of the drivers of terminals."""

import os
from pathlib import Path

import pytest
from fltea.wire import terminal
from fltea.wire.terminal import is_terminal
from fltea.wire.transport import Port


def test_ports_and_what_is_none(tmp_path: Path) -> None:
    master, slave = os.openpty()
    try:
        assert is_terminal(os.ttyname(slave))
    finally:
        os.close(master)
        os.close(slave)
    assert not is_terminal("/dev/null")
    assert not is_terminal(tmp_path)
    assert is_terminal(tmp_path / "missing")


def test_without_the_list_of_the_kernel_nothing_is_excluded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal, "DRIVERS", "/none")
    assert is_terminal("/dev/null")


@pytest.mark.parametrize(("minors", "serves"), [("3", True), ("0-2", False), ("2-9", True), ("4", False)])
def test_a_driver_has_a_range_of_numbers(
    minors: str, serves: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drivers = tmp_path / "drivers"
    drivers.write_text(f"serial /dev/null 1 {minors} serial\n")
    monkeypatch.setattr(terminal, "DRIVERS", str(drivers))
    assert os.minor(os.stat("/dev/null").st_rdev) == 3
    assert is_terminal("/dev/null") == serves


def test_a_device_that_is_no_port_is_named_as_such() -> None:
    failed = Port("/dev/null", 115200).open()
    assert (failed.kind, "no serial port" in failed.message) == ("open_failed", True)
