"""Tests which recorded files the name of a folder, session or file selects, and which names are refused."""

from pathlib import Path

import pytest
from fltea.records.errors import UsageError
from fltea.records.records import Sample
from fltea.sources.mcap import find_session
from fltea.sources.replay import ReplaySource

from tests.rig.blocks import of
from tests.rig.mcap_support import files, record, replay, transport


def test_folder_session_and_file_name_the_same(tmp_path: Path) -> None:
    record(tmp_path, transport(samples=200), rotate_s=1.0)
    session = Path(str(files(tmp_path)[0]).removesuffix("_000.mcap"))
    assert [part.path for part in find_session([session]).parts] == files(tmp_path)
    assert [part.path for part in find_session([tmp_path]).parts] == files(tmp_path)
    assert [part.path for part in find_session(files(tmp_path)[::-1]).parts] == files(tmp_path)
    assert [part.path for part in find_session(files(tmp_path)[:1]).parts] == files(tmp_path)[:1]


def test_several_sessions_are_listed_and_none_is_guessed(tmp_path: Path) -> None:
    for _ in range(2):
        record(tmp_path, transport(samples=100))
    with pytest.raises(UsageError) as refusal:
        replay(tmp_path)
    lines = str(refusal.value).splitlines()
    assert lines[0] == f"{tmp_path}: holds 2 recordings; name one of them:"
    for line in lines[1:]:
        name = line.split()[0]
        assert "(device due, 1 file)" in line
        assert len(of(Sample, replay(Path(name)))) == 98


def test_what_is_no_recording(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "foreign.mcap").write_bytes(b"PK\3\4 no MCAP at all")
    (tmp_path / "nothing.mcap").touch()
    for name, text in (
        ("empty", r"empty: no \.mcap file in this folder"),
        ("none.mcap", r"there is no such file or recording"),
        ("foreign.mcap", r"foreign\.mcap: is cut off or damaged"),
        ("nothing.mcap", r"nothing\.mcap: is no recording of fltea, or was cut"),
        (".", r"no recording of fltea in it \(2 files cannot be read\)"),
    ):
        with pytest.raises(UsageError, match=text):
            ReplaySource(tmp_path / name)


def test_another_programs_mcap_file(tmp_path: Path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "other.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/imu", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with pytest.raises(UsageError, match=r"other\.mcap: has no messages of the type sensor_msgs/Imu"):
        ReplaySource(tmp_path / "other.mcap")


def test_a_later_format_is_refused_by_number(tmp_path: Path) -> None:
    record(tmp_path, transport(samples=60))
    path = files(tmp_path)[0]
    data = path.read_bytes()
    assert b"\6\0\0\0format\1\0\0\0001" in data
    path.write_bytes(data.replace(b"\6\0\0\0format\1\0\0\0001", b"\6\0\0\0format\1\0\0\0002"))
    with pytest.raises(UsageError, match="format 2; this program knows format 1"):
        ReplaySource(path)


def test_a_recovered_copy_stands_for_its_file(tmp_path: Path) -> None:
    record(tmp_path, transport(samples=100))
    path = files(tmp_path)[0]
    copy = path.with_name(f"{path.stem}.recovered.mcap")
    copy.write_bytes(path.read_bytes())
    assert [part.path for part in find_session([tmp_path]).parts] == [copy]
