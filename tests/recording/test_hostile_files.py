"""A file that claims to be huge is refused with exit code 2 and a reason. This takes little memory, and there
is never a traceback.
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from fltea.recording.csv_file import open_csv
from fltea.recording.ndjson import read_ndjson
from fltea.recording.npz_file import open_npz
from fltea.recording.recovery import recover
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.settings.limits import Limits
from fltea.sources.replay import ReplaySource

from tests.rig import hostile_files
from tests.rig.blocks import samples_of
from tests.rig.host_support import fltea_here
from tests.rig.mcap_support import record, transport
from tests.rig.tiers import long_but, slow_but

RIG = Path(__file__).parents[1] / "rig"
SMALL = ["--set", "estimator.startup=2", "--format", "none", "--once"]
MOST_MB = 350
"""Largest permitted growth of the process [MB]. It allows for data up to the limit of 64 MB, which are in
memory twice for a moment, and for the modules that the commands load.
"""


def probed(*commands: Sequence[object]) -> tuple[list[tuple[object, str]], float]:
    """Return exit code and stderr of each command, and by how many MB the process grew."""
    lines = json.dumps([[str(word) for word in command] for command in commands])
    done = subprocess.run(
        [sys.executable, RIG / "command_probe.py"], input=lines, capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout)
    return [(code, text) for code, text in found["results"]], found["after_mb"] - found["before_mb"]


def all_commands(path: Path, out: Path) -> list[list[object]]:
    return [
        ["info", path],
        ["export", path, "--to", out],
        ["export", path, "--to", out, "--what", "estimates"],
        ["identify", path, "--shuffles", 0, "--jobs", 1],
        ["run", "-s", f"replay:{path}", *SMALL],
    ]


@pytest.mark.parametrize("name", long_but(["zstd"], hostile_files.MCAP_BOMBS))
def test_a_chunk_that_unpacks_to_more_than_allowed(name: str, tmp_path: Path) -> None:
    path = tmp_path / "due.mcap"
    path.write_bytes(hostile_files.MCAP_BOMBS[name]())
    results, grown_mb = probed(*all_commands(path, tmp_path / "out.npz"), ["recover", path])
    for code, text in results:
        assert code == 2, text
        assert "due.mcap: the record at byte" in text
        assert "600 MB would be needed" in text
        assert "limit is 64 MB" in text
        assert "--set replay.max_chunk_mb=600" in text
    assert grown_mb < MOST_MB
    assert [found.name for found in tmp_path.iterdir()] == ["due.mcap"]


@pytest.mark.parametrize("name", long_but([], hostile_files.MCAP_LIES, quick=["declares 60 MB"]))
def test_a_chunk_that_lies_about_its_size_is_damaged_and_costs_little(name: str, tmp_path: Path) -> None:
    record(tmp_path, transport(samples=60), channels=())
    (path,) = tmp_path.glob("*.mcap")
    data = path.read_bytes()
    # a chunk that declares a false size or compression is inserted after the 8 bytes that begin the file
    path.write_bytes(data[:8] + hostile_files.MCAP_LIES[name]() + data[8:])
    results, grown_mb = probed(["info", path], ["recover", path, "--in-place"])
    assert [code for code, _ in results] == [1, 0], results
    assert grown_mb < MOST_MB
    # `recover` has nothing left to do: the file is complete now
    assert recover(path, in_place=False).out is None


@pytest.mark.parametrize("kind", slow_but([6], hostile_files.SPARSE_KINDS))
def test_a_record_that_is_as_long_as_the_file(kind: int, tmp_path: Path) -> None:
    path = hostile_files.sparse(tmp_path / "due.mcap", hostile_files.mcap_with(), kind, 3_000_000_000)
    results, grown_mb = probed(["info", path], ["recover", path])
    for code, text in results:
        assert code in ((2,) if kind in hostile_files.SPARSE_KINDS[:2] else (0, 1, 2)), text
        assert code != 1 or "is damaged at byte" in text
        assert kind not in hostile_files.SPARSE_KINDS[:2] or "replay.max_chunk_mb=3000" in text
    assert grown_mb < MOST_MB


@pytest.mark.long
def test_the_limit_of_a_chunk_can_be_raised(tmp_path: Path) -> None:
    record(tmp_path, transport(samples=200))
    (path,) = tmp_path.glob("*.mcap")
    low, high = Limits(max_chunk_mb=0.001), Limits(max_chunk_mb=1)
    with pytest.raises(UsageError, match=r"--set replay\.max_chunk_mb=1$"):
        ReplaySource(path, limits=low)
    assert len(samples_of(ReplaySource(path, limits=high).events())) > 190
    for command in all_commands(path, tmp_path / "out.npz"):
        if command[0] == "identify":
            continue  # the file's two seconds of samples are too few for `identify`
        results, _ = probed(
            [*command, "--set", "replay.max_chunk_mb=0.001"],
            [*command, "--set", "replay.max_chunk_mb=1"],
        )
        assert [code for code, _ in results] == [2, 0], results
        (tmp_path / "out.npz").unlink(missing_ok=True)


@pytest.mark.parametrize(
    ("setting", "reason"),
    [
        ("estimator.window=3", "this command takes replay.max_chunk_mb and replay.max_mb only"),
        ("replay.max_mb=0", "replay.max_mb must be a number above 0 and up to 1000000000 MB, got"),
    ],
)
def test_only_limits_can_be_set_where_nothing_else_is(setting: str, reason: str, tmp_path: Path) -> None:
    found = fltea_here("info", tmp_path, "--set", setting)
    assert found.returncode == 2
    assert reason in found.stderr


@pytest.mark.long
def test_npz_that_takes_more_than_allowed(tmp_path: Path) -> None:
    bombs = hostile_files.npz_bombs(tmp_path)
    results, grown_mb = probed(*[["info", path] for path, _ in bombs.values()])
    for (code, text), (path, word) in zip(results, bombs.values(), strict=True):
        assert code == 2, text
        assert path.name in text
        assert word in text
    assert grown_mb < MOST_MB


def test_the_limit_of_arrays_can_be_raised(tmp_path: Path) -> None:
    path = tmp_path / "rest.npz"
    np.savez(path, gyro_raw=np.zeros((1000, 3), np.int8), fs_hz=100.0, lsb_per_dps=16.4)
    with pytest.raises(
        UsageError, match=r"gyro_raw declares the shape \(1000, 3\): 0\.024 MB .* is 0\.02 MB"
    ):
        open_npz(path, Limits(max_mb=0.02)).whole()
    assert len(open_npz(path, Limits(max_mb=0.025)).whole().gyro) == 1000


def test_a_day_at_100_hz_passes_as_it_is() -> None:
    """A recording of a day with all columns that `export` writes is within the default limits.

    The columns are the rates of three axes in counts, the accelerations of three axes in m/s², two times,
    sequence number and epoch.
    """
    rows = 24 * 3600 * 100
    assert rows * 8 * (3 + 3 + 4) < Limits().whole_bytes


def test_rows_of_csv_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "rest.csv"
    path.write_text("gyro_x_dps\n" + "1\n" * 1000)
    with pytest.raises(UsageError, match=r"rest\.csv:127: .*--set replay\.max_mb=1$"):
        open_csv(path, How(rate_hz=100.0), Limits(max_mb=0.001)).whole()
    assert len(open_csv(path, How(rate_hz=100.0), Limits(max_mb=0.008)).whole().gyro) == 1000


HELLO = b'{"class":"hello","source":"x","host_ns":0,"rate_hz":100,"sampling_mode":"timer"}\n'


def hostile_texts() -> dict[str, tuple[bytes, str]]:
    """Return the bytes of each text file, 300 MB in total, and the expected message about it."""
    return {
        "deep.ndjson": (b'{"a":' * 100_000 + b"\n", "deep.ndjson:1: is not JSON"),
        "deep_array.ndjson": (b"[" * 500_000 + b"\n", "deep_array.ndjson:1: is not JSON"),
        "deep_later.ndjson": (
            HELLO + b'{"class":"sample","a":' * 40_000 + b"\n",
            "deep_later.ndjson:2: is not JSON",
        ),
        "endless.ndjson": (HELLO + b'{"a":"' + b"x" * 100_000_000, "endless.ndjson:2: the line has no end"),
        "endless.csv": (b"time_s,gyro_x_dps\n" + b"1" * 100_000_000, "endless.csv:2: the line has no end"),
        "zeros.csv": (bytes(100_000_000), "zeros.csv: is neither text nor"),
        "nul.csv": (
            b"time_s,gyro_x_dps\n0,\x001\n",
            r"nul.csv:2: column 'gyro_x_dps': '\x001' is not a number",
        ),
        "escape.csv": (b"time_s,gyro_x_dps\n0,\x1b]0;x\x07\n", r"x\x07' is not a number"),
        "colour.csv": (b"time_s,gyro_x_dps\n0,\x1b[31m\n", "column gyro_x_dps is empty"),
        "quote.csv": (b'time_s,gyro_x_dps\n0,"' + b"1\n" * 1_000_000, "quote.csv:2: cannot be read as CSV ("),
        "long.csv": (b"time_s,gyro_x_dps\n0," + b"x" * 100_000 + b"\n", "x…' is not a number"),
        "wide.csv": (
            b",".join(b"c%d" % n for n in range(20_000)) + b"\n1\n",
            "nothing says which columns are the gyroscope's axes",
        ),
        "utf16.csv": ("gyro_x_dps\n1\n".encode("utf-16"), "utf16.csv:1: nothing says the rate"),
    }


@pytest.mark.long
def test_text_without_end_and_without_bottom(tmp_path: Path) -> None:
    texts = hostile_texts()
    for name, (data, _) in texts.items():
        (tmp_path / name).write_bytes(data)
    results, grown_mb = probed(*[["info", tmp_path / name] for name in texts])
    for (code, text), (_, word) in zip(results, texts.values(), strict=True):
        assert code == 2, text
        assert word in text
        assert len(text) < 2000
    assert grown_mb < MOST_MB


def test_lines_as_long_as_they_may_be_are_read(tmp_path: Path) -> None:
    sample = b'{"class":"sample","seq":0,"device_us":0,"host_ns":0,"epoch":1,"gyro_dps":[0.5]'
    path = tmp_path / "run.ndjson"
    path.write_bytes(HELLO + b'{"class":"other","text":"' + b"x" * 900_000 + b'"}\n' + sample + b"}\n")
    hello, found = read_ndjson(path)[0]
    assert (hello.rate_hz, found.gyro_dps) == (100.0, (0.5,))
