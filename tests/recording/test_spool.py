"""Columns that are kept in temporary files, and recordings that are read block by block, give the same result
as those that are read into memory at once.
"""

import io

import numpy as np
import pytest
from fltea.recording.files import AT_ONCE
from fltea.recording.npz_file import open_npz
from fltea.recording.spool import Spool, _close, _Column
from fltea.records.errors import UsageError
from fltea.records.temporary import TemporaryFailed
from hypothesis import given
from hypothesis import strategies as st


@given(cuts=st.lists(st.integers(1, 40), min_size=1, max_size=8), at_once=st.integers(1, 50))
def test_a_column_is_what_was_appended(cuts, at_once):
    n = sum(cuts)
    numbers, pairs = np.arange(n), np.arange(2.0 * n).reshape(n, 2)
    with Spool() as spool:
        begin = 0
        for count in cuts:
            spool.append("numbers", numbers[begin : begin + count])
            spool.append("pairs", pairs[begin : begin + count])
            begin += count
        blocks = list(spool.blocks(["numbers", "pairs"], at_once))
        assert spool.length("numbers") == n
        assert spool.length("nothing") == 0
        np.testing.assert_array_equal(spool.whole("pairs"), pairs)
        spool.drop("numbers")
        assert "numbers" not in spool
    for column, whole in zip(zip(*blocks, strict=True), (numbers, pairs), strict=True):
        np.testing.assert_array_equal(np.concatenate(column), whole)


def test_npz_of_a_spool_is_numpys():
    counts, file = np.arange(30, dtype=np.int32).reshape(10, 3), io.BytesIO()
    with Spool() as spool:
        for part in np.split(counts, [1, 4]):
            spool.append("gyro_raw", part)
            spool.append("t_host_s", part[:, 0] * 0.1)
        spool.write_npz(file, {"fs_hz": 100.0})
    file.seek(0)
    with np.load(file) as found:
        assert found["gyro_raw"].dtype == np.int32
        assert found["fs_hz"].item() == 100.0
        np.testing.assert_array_equal(found["gyro_raw"], counts)
        np.testing.assert_array_equal(found["t_host_s"], counts[:, 0] * 0.1)


@pytest.mark.parametrize("n", [1, AT_ONCE, 2 * AT_ONCE + 7])
@pytest.mark.parametrize("columns_first", [False, True])
def test_npz_in_blocks_is_npz_as_a_whole(tmp_path, n, columns_first):
    rng = np.random.default_rng(n)
    gyro = rng.integers(-99, 99, (3, n)).T if columns_first else rng.integers(-99, 99, (n, 3))
    assert np.isfortran(gyro) == (columns_first and n > 1)
    time_s = np.cumsum(rng.uniform(0.009, 0.011, n))
    path = tmp_path / "rest.npz"
    more = {"accel_raw": rng.integers(-9, 9, (n, 3)), "seq": np.arange(n), "epoch": np.arange(n) // 5000}
    np.savez_compressed(path, gyro_raw=gyro, lsb_per_dps=131.0, fs_hz=100.0, time_s=time_s, **more)
    stored = open_npz(path)
    blocks = list(stored.blocks())
    assert [len(block.gyro) for block in blocks] == [
        *[AT_ONCE] * (n // AT_ONCE),
        *([n % AT_ONCE] if n % AT_ONCE else []),
    ]
    whole = open_npz(path).whole()
    assert stored.samples == n
    np.testing.assert_array_equal(whole.gyro, gyro)
    np.testing.assert_array_equal(whole.device_s, time_s)
    np.testing.assert_array_equal(whole.accel, more["accel_raw"])
    np.testing.assert_array_equal(whole.epoch, more["epoch"])


@pytest.mark.parametrize("row", [0, AT_ONCE - 1, AT_ONCE, AT_ONCE + 9])
@pytest.mark.parametrize("fault", ["nan", "huge", "time"])
def test_a_fault_is_found_in_whatever_block_it_stands(tmp_path, row, fault):
    n = AT_ONCE + 10
    gyro, time_s = np.zeros((n, 1)), np.arange(n) * 0.01
    if fault == "time":
        row = max(row, 1)
        time_s[row] = time_s[row - 1]
    else:
        gyro[row] = np.nan if fault == "nan" else 2e6
    np.savez(tmp_path / "rest.npz", gyro_dps=gyro, fs_hz=100.0, time_s=time_s)
    with pytest.raises(UsageError, match=rf"in row {row}\b"):
        open_npz(tmp_path / "rest.npz")


def test_damage_at_the_end_of_an_array_is_found(tmp_path):
    path = tmp_path / "rest.npz"
    np.savez(path, gyro_dps=np.ones((AT_ONCE + 10, 1)), fs_hz=100.0)
    data = bytearray(path.read_bytes())
    at = data.index(b"fs_hz.npy") - 200  # this byte is in the last rows of the array of rates
    data[at] ^= 1
    path.write_bytes(data)
    with pytest.raises(UsageError, match="cannot be read"):
        open_npz(path)


def test_an_accelerometer_without_its_scale_is_said_not_to_be_read(tmp_path):
    raw = {"gyro_raw": np.ones((3000, 3), np.int16), "lsb_per_dps": 131.0, "fs_hz": 100.0}
    raw["accel_raw"] = np.ones((3000, 3), np.int16)
    for scale, said in (({}, "not read"), ({"accel_lsb_per_g": 16384.0}, "accel_raw")):
        np.savez(tmp_path / "rest.npz", **raw, **scale)
        (answer,) = (
            one for one in open_npz(tmp_path / "rest.npz").reading if one.question == "accelerometer"
        )
        assert said in str(answer)


def test_a_full_disk_is_not_reported_again_when_a_spool_is_closed():
    class Full:
        def close(self):
            raise TemporaryFailed("the folder for temporary files is full")

    _close({"x": _Column(Full(), np.dtype(float), ())})
