"""fltea's own NDJSON is read back without loss, and errors name the line and the reason."""

from pathlib import Path

import pytest
from fltea.recording.ndjson import EpochMark, read_ndjson
from fltea.records.errors import UsageError
from fltea.records.records import Hello, Sample

from tests.rig.text_files import refused

HELLO = '{"class":"hello","source":"x","host_ns":0,"rate_hz":100.0,"sampling_mode":"timer"}'
SAMPLE = '{"class":"sample","seq":0,"epoch":1,"device_us":0,"host_ns":0,"gyro_dps":[1.0,2.0]}'


def ndjson_file(tmp_path: Path, *lines: str) -> Path:
    path = tmp_path / "run.ndjson"
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def test_ndjson_keeps_hello_and_samples_in_order(tmp_path: Path) -> None:
    other = '{"class":"stats","anything":1}'
    found, _ = read_ndjson(ndjson_file(tmp_path, other, HELLO, SAMPLE, other, HELLO, SAMPLE, SAMPLE))
    assert [type(record) for record in found] == [Hello, Sample, Hello, Sample, Sample]


def test_epochs_that_another_version_wrote_are_read(tmp_path: Path) -> None:
    """A replay needs only the reason why an epoch (a run of samples without a restart) began.

    The estimator settings in the record of the epoch are not read, since their form has changed between
    versions.
    """
    old = '{"class":"epoch","epoch":1,"reason":"restart","host_ns":7,"estimator":{"engine":"reference"}}'
    found, _ = read_ndjson(ndjson_file(tmp_path, HELLO, old, SAMPLE))
    assert isinstance(found[1], EpochMark)
    assert (found[1].reason, found[1].host_ns) == ("restart", 7)


def test_ndjson_of_several_devices_is_refused(tmp_path: Path) -> None:
    lines = [line[:-1] + f',"device":"{name}"}}' for name in ("left", "right") for line in (HELLO, SAMPLE)]
    with pytest.raises(UsageError, match=r"several devices \(left, right\)"):
        read_ndjson(ndjson_file(tmp_path, *lines))
    assert len(read_ndjson(ndjson_file(tmp_path, *lines[2:]))[0]) == 2


BAD_NDJSON = {
    "not JSON": ([HELLO, SAMPLE, "{oops"], ":3: is not JSON"),
    "cut": ([HELLO, SAMPLE, SAMPLE[:40]], ":3: is not JSON"),
    "blank line": ([HELLO, "", SAMPLE], ":2: is not JSON"),
    "NaN": ([HELLO, SAMPLE.replace("1.0", "NaN")], ":2: is not JSON"),
    "Infinity": ([HELLO, SAMPLE.replace("1.0", "-Infinity")], ":2: is not JSON"),
    "too large": ([HELLO, SAMPLE.replace("1.0", "1e999")], ":2: is not JSON"),
    "a number": ([HELLO, "17"], ":2: is not a record of fltea"),
    "a list": ([HELLO, "[1]"], ":2: is not a record of fltea"),
    "other objects": ([HELLO, '{"a":1}'], ":2: is not a record of fltea"),
    "null": ([HELLO, SAMPLE, SAMPLE.replace("1.0", "null")], ":3: is a damaged record", "gyro_dps[0]"),
    "text": ([HELLO, SAMPLE.replace("1.0", '"1"')], ":2: is a damaged record", "gyro_dps[0]"),
    "unknown field": ([HELLO.replace("rate_hz", "rate")], ":1: is a damaged record", "`rate`"),
    "missing field": ([HELLO, SAMPLE.replace('"seq":0,', "")], ":2: is a damaged record", "`seq`"),
    "rate 0": ([HELLO.replace("100.0", "0"), SAMPLE], ":1: is a damaged record", "positive"),
    "scale 0": ([HELLO[:-1] + ',"gyro_lsb_per_dps":-1}', SAMPLE], ":1: is a damaged record", "positive"),
    "no hello": ([SAMPLE], ":1: is a damaged record", "before any hello"),
    "no axes": ([HELLO, SAMPLE.replace("1.0,2.0", "")], ":2: is a damaged record", "0 axes"),
    "four axes": ([HELLO, SAMPLE.replace("1.0", "1,1,1")], ":2: is a damaged record", "4 axes"),
    "another axis": ([HELLO, SAMPLE, SAMPLE.replace("1.0", "1,1")], ":3: ", "3 axes, 2 before"),
    "no axes of the accelerometer": (
        [HELLO, SAMPLE[:-1] + ',"accel_ms2":[]}'],
        ":2: ",
        "accel_ms2 has 0 axes",
    ),
    "no samples": ([HELLO], "holds no sample records", "--samples"),
    "empty": ([], "holds no sample records"),
}


@pytest.mark.parametrize("name", BAD_NDJSON)
def test_bad_ndjson(name: str, tmp_path: Path) -> None:
    lines, *words = BAD_NDJSON[name]
    path = ndjson_file(tmp_path, *lines)
    reason = refused(path, read_ndjson)
    assert reason.startswith(":"), reason
    for word in words:
        assert word in reason


def test_ndjson_that_is_not_text(tmp_path: Path) -> None:
    (tmp_path / "run.ndjson").write_bytes(b"\xff\xfe")
    assert ":1: is not JSON" in refused(tmp_path / "run.ndjson", read_ndjson)


def test_a_last_line_that_is_cut_is_left_out_and_told(tmp_path: Path) -> None:
    path = ndjson_file(tmp_path, HELLO, SAMPLE, SAMPLE)
    assert read_ndjson(path)[1] is None
    path.write_bytes(path.read_bytes()[:-20])
    found, cut = read_ndjson(path)
    assert [type(record) for record in found] == [Hello, Sample]
    assert cut is not None
    assert ":3: the last line is cut off" in cut
