"""Tests of the rate and the clock of live text: neither is made up."""

import json
from pathlib import Path

import numpy as np
import pytest
from fltea.settings.how import How
from fltea.sources.text_events import TextEvents

from tests.rig.host_support import fltea_here


@pytest.mark.parametrize("times", [False, True])
def test_a_table_through_a_pipe_tells_neither_rate_nor_clock(times: bool, tmp_path: Path) -> None:
    """The rate would be that at which the program reads."""
    path = tmp_path / "rest.csv"
    gyro = np.random.default_rng(3).normal(0, 0.1, (6000, 3))
    columns = np.column_stack([np.arange(6000) * 10, gyro]) if times else gyro
    np.savetxt(path, columns, "%.5g", ",", header="t_ms,gx,gy,gz" if times else "gx,gy,gz", comments="")
    how = [] if times else ["--columns", "1,2,3", "--rate", "100"]
    done = fltea_here(
        "run",
        "-s",
        f"stdin:{path}",
        "--units",
        "dps",
        *how,
        "--once",
        "--format",
        "ndjson",
        "--set",
        "live.on=false",
    )
    assert done.returncode == 0, done.stderr
    stats = [record for line in done.stdout.splitlines() if (record := json.loads(line))["class"] == "stats"]
    assert stats[-1]["sample_counts"]["delivered"] == 6000
    assert (stats[-1]["rate_hz"], stats[-1]["clock_ppm"]) == (None, None)


def test_only_text_with_even_times_has_a_clock() -> None:
    """Without times, device times are computed from the rate that the user states."""
    for how, data, expected in (
        (How(units="dps", rate_hz=100.0), b"gx,gy\n" + b"1,2\n" * 300, False),
        (How(units="dps"), b"t_ms,gx\n" + b"".join(b"%d,1\n" % (10 * k) for k in range(300)), True),
    ):
        live = TextEvents("stdin:", how, fatal=False)
        live.open(0, within_line=False)
        assert not live.has_clock
        list(live.feed(data, 10**9))
        assert live.has_clock == expected
