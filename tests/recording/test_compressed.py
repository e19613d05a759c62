"""Tests compressed text, archives with several files, missing libraries, and topics of PX4 logs."""

import bz2
import gzip
import lzma
import shlex
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from fltea.archive.info import as_text, summarise
from fltea.recording.formats import FORMATS
from fltea.records.errors import UsageError
from fltea.records.events import Trouble
from fltea.settings.how import How
from fltea.sources.replay import ReplaySource

from tests.rig.blocks import samples_of
from tests.rig.corpus_files import HERE, N, text
from tests.rig.tiers import slow_but


def archive(path: Path, **files: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for name, data in files.items():
            out.writestr(f"{name}.csv", data)
    return path


PACK = {"gz": gzip.compress, "bz2": bz2.compress, "xz": lzma.compress}
NDJSON = b"".join(
    (
        b'{"class":"hello","source":"x","host_ns":0,"rate_hz":100,"sampling_mode":"timer"}\n',
        *(
            b'{"class":"sample","seq":%d,"device_us":%d,"host_ns":%d,"epoch":1,"gyro_dps":[0.5]}\n'
            % (k, k * 10_000, k * 10_000_000)
            for k in range(N)
        ),
    )
)
OBJECTS = b"".join(b'{"t_ms":%d,"wx_rads":0.5}\n' % (k * 10) for k in range(N))
DOCUMENT = b"[" + OBJECTS.replace(b"\n", b",").rstrip(b",") + b"]"


@pytest.mark.parametrize("name", ["plain.csv.gz", "plain.csv.xz"])
def test_what_is_cut_off_is_read_as_far_as_it_goes(name: str, tmp_path: Path) -> None:
    data = (HERE / name).read_bytes()
    (tmp_path / name).write_bytes(data[: len(data) * 3 // 4])
    events = list(ReplaySource(tmp_path / name).events())
    assert 20 < len(samples_of(events)) < N
    assert "is cut off; what can be decompressed is read" in next(
        e.message for e in events if isinstance(e, Trouble)
    )
    (tmp_path / name).write_bytes(data[:40] + bytes(len(data) - 40))
    with pytest.raises(UsageError, match=r"is damaged \(.+\): copy it again"):
        ReplaySource(tmp_path / name)


@pytest.mark.parametrize("packer", PACK)
@pytest.mark.parametrize("rest", [b"rubbish" * 5, b"\x1f"])
def test_bytes_behind_the_compressed_data_are_told(packer: str, rest: bytes, tmp_path: Path) -> None:
    """The library refuses such a file of gzip, and says nothing of them for the others."""
    for name, content in (("rest.csv", text("plain.csv")), ("rest.ndjson", NDJSON)):
        path = tmp_path / f"{name}.{packer}"
        path.write_bytes(PACK[packer](content) + rest)
        events = list(ReplaySource(path).events())
        assert len(samples_of(events)) == N
        (said,) = [one.message for one in events if isinstance(one, Trouble)]
        assert said.startswith(f"{path}: is followed by bytes that are not compressed")


@pytest.mark.parametrize("packer", PACK)
def test_zeros_and_more_compressed_data_behind_are_no_damage(packer: str, tmp_path: Path) -> None:
    first, rows = text("plain.csv")[:2000].rpartition(b"\n")[0] + b"\n", text("plain.csv")
    path = tmp_path / f"rest.csv.{packer}"
    path.write_bytes(PACK[packer](first) + PACK[packer](rows[len(first) :]) + bytes(64))
    events = list(ReplaySource(path).events())
    assert len(samples_of(events)) == N
    assert not [one for one in events if isinstance(one, Trouble)]


@pytest.mark.parametrize("packer", PACK)
def test_damage_is_told_with_the_command_that_unpacks_what_is_left(packer: str, tmp_path: Path) -> None:
    content = b"time_s,gyro_x_dps\n" + b"".join(
        b"%.2f,%.4f\n" % (k / 100, value)
        for k, value in enumerate(np.random.default_rng(1).normal(size=150_000))
    )
    data = PACK[packer](content)
    at = len(data) * 9 // 10
    path = tmp_path / f"two words.csv.{packer}"
    path.write_bytes(data[:at] + bytes(64) + data[at + 64 :])
    with pytest.raises(UsageError, match=r"is damaged \(.*\): copy it again, or unpack what") as caught:
        ReplaySource(path)
    command = str(caught.value).partition("may be wrong: ")[2]
    subprocess.run(command, shell=True, stderr=subprocess.DEVNULL, check=False)
    left = path.with_suffix("").read_bytes()
    assert left[: len(content) // 2] == content[: len(content) // 2]


def test_of_an_archive_the_file_of_the_gyroscope_is_read(tmp_path: Path) -> None:
    plain = text("plain.csv")
    path = archive(tmp_path / "a.zip", Accelerometer=b"time,x\n0,1\n", MyGyro=plain, Metadata=b"a\n")
    assert len(samples_of(ReplaySource(path).events())) == N
    path = archive(tmp_path / "b.zip", one=plain, two=text("iso_dates.csv"))
    with pytest.raises(
        UsageError, match=r"holds 2 files, .*\(one\.csv, two\.csv\).*: python3 -m zipfile -e (.*)"
    ) as caught:
        ReplaySource(path)
    command = str(caught.value).rpartition(": python3 ")[2].split()
    subprocess.run([sys.executable, *command], cwd=tmp_path, check=True)
    assert len(samples_of(ReplaySource(tmp_path / "one.csv").events())) == N


INSIDE = {
    "rest.ndjson": NDJSON,
    "objects.ndjson": OBJECTS,
    "rest.json": DOCUMENT,
    "rest.yaml": text("plain.csv"),
    "rest.gcsv": text("plain.csv"),
    "rest": text("plain.csv"),
    "rest.xlsx": text("phyphox.xlsx"),
    "flight.ulg": text("px4.ulg"),
    "rest.parquet": text("pandas.parquet"),
}


@pytest.mark.parametrize("packer", slow_but(["gz", "zip"], [*PACK, "zip"]))
@pytest.mark.parametrize("name", slow_but(["objects.ndjson", "rest.json", "rest"], INSIDE))
def test_what_is_packed_is_read_as_what_it_is(name: str, packer: str, tmp_path: Path) -> None:
    path = tmp_path / f"{name}.{packer}"
    if packer == "zip":
        with zipfile.ZipFile(path, "w") as out:
            out.writestr(name, INSIDE[name])
    else:
        path.write_bytes(PACK[packer](INSIDE[name]))
    assert len(samples_of(ReplaySource(path).events())) == N
    if name == "rest.ndjson":
        with pytest.raises(UsageError, match=r"--units is not for fltea's own output"):
            ReplaySource(path, how=How(units="dps"))
        with pytest.raises(UsageError, match="--shuffle works on"):
            ReplaySource(path, shuffle=1)


@pytest.mark.parametrize("name", ["h5py.h5", "matlab73.mat", "pandas_table.h5"])
def test_hdf5_is_read_from_a_file_without_a_name(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"{name}.gz"
    path.write_bytes(gzip.compress((HERE / name).read_bytes()))
    plain, compressed = (samples_of(ReplaySource(one).events()) for one in (HERE / name, path))
    assert len(compressed) == len(plain) > 0


@pytest.mark.parametrize(
    ("inside", "reason"),
    [
        (
            gzip.compress(text("plain.csv")),
            r"holds a compressed file, which is not read while it is compressed; ",
        ),
        (b"\x93NUMPY" + bytes(99), r"holds \.npy of numpy, which is not read while it is compressed; "),
        (
            b"x".ljust(257, b"\0") + b"ustar",
            r"is compressed; .*Inside, \S*two words.csv: is an archive of tar\. ",
        ),
        (b"", r"is compressed; .*Inside, \S*two words.csv: is empty\."),
    ],
)
def test_what_has_to_be_unpacked_first_is_told_with_the_command(
    inside: bytes, reason: str, tmp_path: Path
) -> None:
    path = tmp_path / "two words.csv.gz"
    path.write_bytes(gzip.compress(inside))
    with pytest.raises(UsageError, match=reason) as caught:
        ReplaySource(path)
    command = str(caught.value).partition("unpack it first: ")[2].partition(". Inside")[0]
    subprocess.run(shlex.split(command), check=True)
    assert path.with_suffix("").read_bytes() == inside


NPY = b"\x93NUMPY" + np.random.default_rng(1).bytes(2_000_000)
"""Incompressible and of a format that is not read while it is compressed."""


@pytest.mark.parametrize("packer", PACK)
def test_the_command_for_a_file_that_is_cut_gives_what_is_left_of_it(packer: str, tmp_path: Path) -> None:
    """`gzip -d` removes what it has written when the file ends too early."""
    path = tmp_path / f"two words.npy.{packer}"
    path.write_bytes(PACK[packer](NPY)[:-1000])
    with pytest.raises(UsageError, match="it is cut off, and this unpacks what is left of it: ") as caught:
        ReplaySource(path)
    command = str(caught.value).partition("what is left of it: ")[2]
    subprocess.run(command, shell=True, stderr=subprocess.DEVNULL, check=False)
    left = path.with_suffix("").read_bytes()
    assert len(left) > len(NPY) / 3
    assert NPY.startswith(left)


def test_the_command_works_for_a_name_without_the_usual_ending(tmp_path: Path) -> None:
    """`gzip -d` refuses such a name."""
    path = tmp_path / "rest.npy"
    path.write_bytes(gzip.compress(NPY))
    with pytest.raises(UsageError, match="unpack it first: ") as caught:
        ReplaySource(path)
    subprocess.run(str(caught.value).partition("unpack it first: ")[2], shell=True, check=True)
    assert (tmp_path / "rest.npy.unpacked").read_bytes() == NPY


@pytest.mark.parametrize("packer", [*PACK, "zip"])
def test_a_file_that_is_cut_before_anything_can_be_decompressed(packer: str, tmp_path: Path) -> None:
    """That it is empty would be untrue, and unpacking it would not help."""
    path = tmp_path / f"rest.csv.{packer}"
    if packer == "zip":
        archive(path, rest=text("plain.csv"))
    else:
        path.write_bytes(PACK[packer](text("plain.csv")))
    path.write_bytes(path.read_bytes()[:30])
    reason = (
        "is cut off or damaged: what stands at the end"
        if packer == "zip"
        else "is cut off, and nothing of what is left"
    )
    with pytest.raises(UsageError, match=rf"rest\.csv\.\w+: {reason}.* [Cc]opy it again") as caught:
        ReplaySource(path)
    assert "unpack" not in str(caught.value)


def test_notes_name_the_file_that_the_user_named(tmp_path: Path) -> None:
    """The library reads the content from a descriptor or a temporary file."""
    path = tmp_path / "flight.ulg.gz"
    data = gzip.compress(text("px4.ulg"))
    path.write_bytes(data[: len(data) * 3 // 4])
    texts = [one.message for one in ReplaySource(path).events() if isinstance(one, Trouble)]
    assert len(texts) == 2
    assert all(text.startswith(f"{path}: ") for text in texts)


def test_own_output_that_is_cut_between_two_lines_says_so(tmp_path: Path) -> None:
    path = tmp_path / "rest.ndjson.gz"
    packer = zlib.compressobj(wbits=31)
    path.write_bytes(packer.compress(NDJSON) + packer.flush(zlib.Z_FULL_FLUSH))
    events = list(ReplaySource(path).events())
    assert len(samples_of(events)) == N
    assert [one.message for one in events if isinstance(one, Trouble)] == [
        f"{path}: is cut off; what can be decompressed is read."
    ]
    assert "fltea recover" not in as_text(summarise([path], 100))


@pytest.mark.parametrize("kind", [kind for kind, form in FORMATS.items() if form.library])
def test_a_library_that_is_missing_is_named_with_what_installs_it(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    form = FORMATS[kind]
    monkeypatch.setitem(sys.modules, form.library, None)
    with pytest.raises(
        UsageError, match=rf"{form.title} files need the package {form.library}.*\[{form.extra}\]"
    ):
        ReplaySource(HERE / next(iter(form.corpus)))


@pytest.mark.slow
def test_a_topic_of_px4_that_is_not_there() -> None:
    assert len(samples_of(ReplaySource(HERE / "px4.ulg", how=How(topic="sensor_combined")).events())) == N
    with pytest.raises(
        UsageError, match=r"is a PX4 log with no topic sensor_gps; name one by --topic: sensor_combined\."
    ):
        ReplaySource(HERE / "px4.ulg", how=How(topic="sensor_gps"))
