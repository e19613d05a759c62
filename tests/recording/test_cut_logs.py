"""Logs of ArduPilot and TDMS files of LabVIEW that are cut off or damaged say what is left out."""

import gc
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fltea.recording.files import Note

from tests.rig.corpus_files import GYRO_DPS, HERE, N
from tests.rig.table_support import stored_here

pytestmark = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
"""Ignores warnings about files left open. Normally they are closed when the reader process ends."""

LOG = (HERE / "ardupilot.bin").read_bytes()
MESSAGE_BYTES = 54
TDMS = (HERE / "labview.tdms").read_bytes()


@pytest.fixture(autouse=True, scope="module")
def closed_files() -> Iterator[None]:
    """Close at once the files that readers left open, and not in the middle of another test."""
    yield
    gc.collect()


def notes_of(path: Path, data: bytes, left: list[int]) -> tuple[Note, ...]:
    """Read a log, check that it holds the samples `left`, and return the notes about it."""
    path.write_bytes(data)
    found = stored_here(path)
    assert found.whole().gyro == pytest.approx(GYRO_DPS[left], abs=1e-5)
    return found.notes


@pytest.mark.parametrize("lacking", [1, 20, MESSAGE_BYTES - 1])
def test_the_last_bytes_of_a_cut_log_of_ardupilot_are_counted(lacking: int, tmp_path: Path) -> None:
    (note,) = notes_of(tmp_path / "log.bin", LOG[:-lacking], [*range(N - 1)])
    assert note.kind == "cut_recording"
    assert f"log.bin: its last {MESSAGE_BYTES - lacking} bytes are no whole message" in note.text


@pytest.mark.parametrize("lost", [0, 30, N - 1])
def test_bytes_of_a_log_of_ardupilot_that_are_no_message_are_counted(lost: int, tmp_path: Path) -> None:
    """Damaged bytes are counted, because times do not show every loss: if the first samples are lost, there
    is no gap between times.
    """
    at = len(LOG) - (N - lost) * MESSAGE_BYTES
    data = LOG[:at] + LOG[at + 5 : at + MESSAGE_BYTES].replace(b"\xa3", b"\0") + LOG[at + MESSAGE_BYTES :]
    (note,) = notes_of(tmp_path / "log.bin", data, [k for k in range(N) if k != lost])
    is_last = lost == N - 1
    assert note.kind == ("cut_recording" if is_last else "recording_gap")
    assert f"{MESSAGE_BYTES - 5} bytes " in note.text


@pytest.mark.parametrize("padding", [b"\xff" * 249, bytes(527), b""])
def test_padding_at_the_end_of_a_log_of_ardupilot_is_no_loss(padding: bytes, tmp_path: Path) -> None:
    assert notes_of(tmp_path / "log.bin", LOG + padding, [*range(N)]) == ()


def test_a_tdms_file_that_was_never_finished_is_noted(tmp_path: Path) -> None:
    """All bits of the length of a part are set until LabVIEW has finished the part."""
    data = bytearray(TDMS)
    struct.pack_into("<Q", data, 12, (1 << 64) - 1)
    (note,) = notes_of(tmp_path / "rest.tdms", bytes(data), [*range(N)])
    assert (note.kind, "ends within its last part" in note.text) == ("cut_recording", True)


@pytest.mark.parametrize("end", [len(TDMS) - 955, len(TDMS) - 960, len(TDMS) - 1200])
def test_a_tdms_file_that_is_cut_off_is_noted(end: int, tmp_path: Path) -> None:
    """The library gives the channels that are left, so that an axis or two may be missing."""
    (tmp_path / "rest.tdms").write_bytes(TDMS[:end])
    found = stored_here(tmp_path / "rest.tdms")
    assert found.whole().gyro.shape[1] < 3
    assert [note.kind for note in found.notes] == ["cut_recording"]


def test_a_tdms_file_that_is_whole_has_no_note(tmp_path: Path) -> None:
    assert notes_of(tmp_path / "rest.tdms", TDMS + TDMS, [*range(N), *range(N)])[0].kind == "reading"
    assert np.size(notes_of(tmp_path / "one.tdms", TDMS, [*range(N)])) == 0
