"""Tests, without a board, of the summary that `fltea record` prints at its end."""

from pathlib import Path

import pytest
from fltea.archive.record import record
from fltea.records.errors import FlteaError, UsageError
from fltea.settings.config import load_configs


def recorded(folder: Path, source: str, **more: object) -> str:
    settings = {"record.folder": str(folder), "pace": "fast", **more}
    return record(load_configs(None, settings, [source])[0], None)


def test_the_summary_says_what_there_is_and_what_is_missing(tmp_path: Path) -> None:
    folder = tmp_path / "rec"
    assert recorded(folder, "synthetic:?n=60").endswith(
        f": 60 samples at 100.00 Hz, 0 lost in 0 gaps; 1 file in {folder}"
    )
    assert len(list(folder.glob("*.mcap"))) == 1


def test_a_recording_is_none_to_be_recorded(tmp_path: Path) -> None:
    rows = "".join(f"{k / 100},{k * 7 % 11}\n" for k in range(600))
    (tmp_path / "a.csv").write_text(f"time_s,gyro_x_dps\n{rows}")
    with pytest.raises(UsageError, match="this source is a recording already"):
        recorded(tmp_path / "rec", f"replay:{tmp_path / 'a.csv'}")


def test_a_port_that_could_never_be_opened_is_a_failure(tmp_path: Path) -> None:
    """The recording is empty, and a script that looks at the exit code would take it for one."""
    settings = {"record.folder": str(tmp_path / "rec")}
    config = load_configs(None, settings, [f"serial:{tmp_path / 'no-port'}"])[0]
    with pytest.raises(
        FlteaError, match=r"0 samples, .*Nothing arrived: there is no port .*no-port"
    ) as caught:
        record(config, 0.01)
    assert caught.value.exit_code == 1
