"""A large file is summed in pieces, and the result is the same as that of the whole file.

It does not matter which worker sums a piece, or whether a worker dies.
"""

from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from fltea.cluster.listing import File, files_of
from fltea.cluster.pieces import cuts_of
from fltea.cluster.summed import PieceSums, fit_pieces, sum_piece
from fltea.cluster.whole import Ask, identify_file
from fltea.identification.workers import Here
from fltea.settings.how import How

from tests.rig.cluster_support import ASK, identified, rows_in, values
from tests.rig.identify_support import long_recursion, white

N = 1 << 16
NOISE = 0.05 * white(N, 1, 1)[0] + 0.05 * long_recursion(0.6, -0.19, N, 2)
TOLERANCE = 0.5
"""Largest permitted difference between a figure of the noise (such as N) that is computed from pieces, and
the same figure from the whole file, for pieces of at least 16,384 samples. The unit is half the width of the
figure's 95 % interval.

Among 36 noises the largest difference is 0.33. A block of 64 MB, the usual size of a piece, has a hundred
times as many samples.
"""
FEW = 1 << 12
SHORT = 0.05 * white(FEW, 1, 3)[0] + 1.5
VALUES = ("alpha", "F", "s2", "R", "N")
HOW = How(rate_hz=100.0, units="deg/s")


def ask(pieces: int, samples: int = FEW) -> Ask:
    return msgspec.structs.replace(ASK, how=HOW, block_bytes=8 * samples // pieces + 256)


def saved(folder: Path, y: np.ndarray) -> File:
    np.save(folder / "a.npy", y)
    (file,) = files_of([str(folder / "a.npy")])
    assert isinstance(file, File)
    return file


def summed(file: File, pieces: int = 4, samples: int = FEW) -> list[PieceSums | str]:
    how = ask(pieces, samples)
    return [sum_piece(file, cut, how) for cut in cuts_of(file, how)]


def test_the_answer_of_the_whole(tmp_path: Path) -> None:
    file = saved(tmp_path, NOISE)
    (whole,) = identify_file(file, ask(1, N))
    (row,) = fit_pieces(file, ask(4, N), summed(file, 4, N))
    assert (row.kind, row.parts, row.unit, row.samples) == (whole.kind, 4, whole.unit, whole.samples)
    assert (row.lost, row.rate_hz, row.lsb) == (whole.lost, pytest.approx(whole.rate_hz), whole.lsb)
    assert (row.mean, row.std) == (pytest.approx(whole.mean), pytest.approx(whole.std, rel=1e-9))
    compared = 0
    for name in VALUES:
        value, low, high = (whole.values[name + end] for end in ("", "_low", "_high"))
        assert (row.values[name] is None) == (value is None), name
        if value is not None:
            assert abs(row.values[name] - value) <= TOLERANCE * (high - low) / 2, name
            compared += 1
    assert compared
    assert row.fltea_alpha is None


def test_a_change_is_seen_across_pieces(tmp_path: Path) -> None:
    """No single piece shows that the noise changes, but the sums of all pieces do. The Allan deviation is
    that of all pieces together.
    """
    louder = np.repeat([1.0, 1.0, 2.0, 2.0], FEW // 4)
    file = saved(tmp_path, louder * (SHORT - 1.5))
    (whole,) = identify_file(file, ask(1))
    (row,) = fit_pieces(file, ask(4), summed(file))
    assert row.kind == whole.kind == "not stationary"
    assert row.values["N"] == pytest.approx(whole.values["N"], rel=0.02)


def test_a_phone_says_in_the_name_of_a_file_whose_columns_these_are(tmp_path: Path) -> None:
    path = tmp_path / "2026-11-24 Gyroscope.csv"
    lines = [f"{10_000_000 * k},{k / 100:.2f},{-y:.5f},{2 * y:.5f},{y:.5f}\n" for k, y in enumerate(SHORT)]
    path.write_text("time,seconds_elapsed,z,y,x\n" + "".join(lines))
    (file,) = files_of([str(path)])
    assert isinstance(file, File)
    how = msgspec.structs.replace(ASK, block_bytes=path.stat().st_size // 4)
    sums = [sum_piece(file, cut, how) for cut in cuts_of(file, how)]
    assert len(sums) > 1
    rows = fit_pieces(file, how, sums)
    assert [row.error for row in rows] == [None] * 3
    assert rows[0].mean == pytest.approx(np.degrees(SHORT.mean()), rel=1e-4)
    elsewhere = file._replace(protocol="s3", path="lab/my gyro log.CSV")
    assert elsewhere.copied_name == "my_gyro_log.csv"
    assert file._replace(path="..-._.csv").copied_name == "recording.csv"
    assert file._replace(path="lab/rest.json.gz").copied_name == "rest.json.gz"
    assert file._replace(path="lab/due-0003.mcap").copied_name == "recording.mcap"


def test_pieces_of_other_scales_are_left_out(tmp_path: Path) -> None:
    file = saved(tmp_path, SHORT)
    sums = summed(file)
    assert isinstance(sums[1], PieceSums)
    sums[1] = msgspec.structs.replace(sums[1], rate_hz=200.0)
    (row,) = fit_pieces(file, ask(4), sums)
    assert (row.parts, row.samples, row.rate_hz) == (3, FEW * 3 // 4, pytest.approx(100))


def test_a_bad_piece_fails_its_file_once(tmp_path: Path) -> None:
    bad = np.array(SHORT)
    bad[FEW // 4 :] = 1e9
    np.save(tmp_path / "bad.npy", bad)
    np.save(tmp_path / "good.npy", SHORT[:1000])
    out = tmp_path / "v.parquet"
    done = identified(f"{tmp_path}/*.npy", ask(8), out, Here())
    assert (done.done, done.failed) == (2, 1)
    failure, good = rows_in(out)
    assert failure["error"].startswith("piece 3 of 8: ")
    assert "bad.npy from byte" in failure["error"]
    assert (failure["again"], good["error"]) == (False, None)


def test_a_piece_without_a_number_is_a_gap(tmp_path: Path) -> None:
    holed = np.array(SHORT)
    holed[FEW // 4 : FEW // 2] = np.nan
    file = saved(tmp_path, holed)
    (whole,) = identify_file(file, ask(1))
    (row,) = fit_pieces(file, ask(4), summed(file))
    assert (row.error, row.parts, row.samples, row.lost) == (None, 3, FEW * 3 // 4, FEW // 4)
    assert (row.lost, row.kind) == (whole.lost, whole.kind)
    assert "missing_numbers" in (row.data_checks or [])
    nothing = saved(tmp_path, holed * np.nan)
    (row,) = fit_pieces(nothing, ask(4), summed(nothing))
    assert "a.npy from byte" in (row.error or "")
    assert "column 1 is empty" in (row.error or "")
    assert (row.again, row.parts) == (False, 4)


class Dying(Here):
    """Workers that die when they get the task `fatal`, up to `times` times.

    They accept no further task until `renew` is called.
    """

    slots = 3

    def __init__(self, fatal: Callable[..., Any], times: int) -> None:
        self.fatal, self.times, self.broken, self.begun = fatal, times, False, 0

    def submit(self, task: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        if self.broken:
            raise BrokenExecutor
        self.begun += 1
        if task is not self.fatal or self.times == 0:
            return super().submit(task, *arguments)
        self.times -= 1
        self.broken = True
        future: Future[Any] = Future()
        future.set_exception(BrokenExecutor())
        return future

    def renew(self) -> None:
        self.broken = False


@pytest.mark.parametrize("task", [cuts_of, sum_piece])
def test_a_process_that_dies_once_costs_nothing(task: Callable[..., Any], tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SHORT)
    np.save(tmp_path / "b.npy", SHORT[:500])
    identified(f"{tmp_path}/*.npy", ask(4), tmp_path / "v.parquet", Here())
    workers = Dying(task, 1)
    done = identified(f"{tmp_path}/*.npy", ask(4), tmp_path / "w.parquet", workers)
    assert (workers.times, done.done, done.failed) == (0, 2, 0)
    assert values(tmp_path / "w.parquet") == values(tmp_path / "v.parquet")


def test_what_kills_every_process_is_a_row_and_tried_in_the_next_run(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SHORT)
    np.save(tmp_path / "b.npy", SHORT[:500])
    out = tmp_path / "v.parquet"
    done = identified(f"{tmp_path}/*.npy", ask(4), out, Dying(sum_piece, 99))
    assert (done.done, done.failed) == (2, 1)
    bad, good = rows_in(out)
    assert "was killed" in bad["error"]
    assert (bad["again"], good["error"]) == (True, None)
    assert identified(f"{tmp_path}/*.npy", ask(4), out, Here()).done == 1
    assert [row["error"] for row in rows_in(out)] == [None, None]
