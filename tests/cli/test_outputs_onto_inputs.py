"""No output of `fltea identify` replaces the recording that it is made of."""

from pathlib import Path

import pytest
from fltea.records.errors import UsageError

from tests.rig.host_support import fltea_here


@pytest.mark.parametrize("flag", ["--export-model", "--imu-yaml", "--gauss-markov", "--allan-csv"])
@pytest.mark.parametrize("through", ["name", "link"])
def test_a_recording_is_not_replaced(flag: str, through: str, tmp_path: Path) -> None:
    recording = tmp_path / "rest.csv"
    recording.write_text("time_s,gyro_x_dps\n0,1\n0.01,2\n")
    before, out = recording.read_bytes(), recording
    if through == "link":
        out = tmp_path / "out.csv"
        out.symlink_to(recording)
    done = fltea_here("identify", recording, flag, out)
    assert done.returncode == UsageError.exit_code
    assert f"{flag} {out}: is the recording itself" in done.stderr
    assert recording.read_bytes() == before
