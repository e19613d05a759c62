"""Tests compressed text, archives with several files, missing libraries, and topics of PX4 logs."""

import bz2
import gzip
import lzma
import shlex
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
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
    with pytest.raises(UsageError, match=r"cannot be (decompressed|read)"):
        ReplaySource(tmp_path / name)


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
PACK = {"gz": gzip.compress, "bz2": bz2.compress, "xz": lzma.compress}


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
