"""A start imports what the run works with, and no more: each module takes its time on a Raspberry Pi."""

import subprocess
import sys
from pathlib import Path

import numpy as np

HEAVY = {
    *(
        "asyncio",
        "dask",
        "email",
        "fontTools",
        "http.client",
        "IPython",
        "matplotlib",
        "mcap",
        "nats",
        "tornado",
    ),
    *("paho", "pandas", "PIL", "prometheus_client", "pyarrow", "rich", "scipy", "smbus2", "sqlite3", "ssl"),
    *("fltea.api", "fltea.archive", "fltea.cluster", "fltea.fleet", "fltea.lab", "fltea.machine"),
    *(
        "fltea.service.ingest",
        "fltea.sinks.mqtt",
        "fltea.sinks.page",
        "fltea.sinks.table",
        "fltea.sources.iio",
    ),
    *("fltea.recording.csv_file", "fltea.sources.synthetic", "fltea.sources.text_lines"),
}


def test_a_replay_imports_nothing_that_it_does_not_need(tmp_path: Path) -> None:
    gyro = np.random.default_rng(1).normal(0, 3, (600, 3)).round().astype(np.int16)
    np.savez(tmp_path / "rest.npz", gyro_raw=gyro, lsb_per_dps=16.4, fs_hz=100.0)
    arguments = ["run", "-s", f"replay:{tmp_path / 'rest.npz'}", "--once", "--format", "ndjson"]
    command = [sys.executable, "-X", "importtime", "-m", "fltea", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert '"class":"estimate"' in done.stdout
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert {"fltea.stream.pipeline", "fltea.sinks.ndjson"} <= imported
    assert sorted(HEAVY & imported) == []
