"""The table of all file formats that are read, or that are recognized and not read.

Recognition, readers, help, errors and the table of `host/docs/guide/files.md` are derived from this table.
`host/CHANGING.md` says what a new format needs beside a row here; tests name each file in which the new
format is missing.
"""

import importlib
import shlex
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

Kind = str
"""A key of `FORMATS`."""

ALL = ("columns", "units", "rate_hz", "time_column", "time_unit", "topic", "accel_units", "overrule")
"""All fields of `How` (the user's options about a file) that describe columns. Some formats allow them
all.
"""

ZIP = b"PK\x03\x04"

_ANY_TEXT = "text may begin with anything"
_ZIP_ARCHIVE = "a zip archive, which its members tell from others"


# Why more than 12 attributes: each is one column of the table of formats.
class Format(NamedTuple):
    """A file format that fltea reads.

    `title`: name for people. `guide`: description in the guide. `suffixes`: endings of file names.
    `is_certain`: whether such an ending alone proves the format. If not, as for .bin, the first bytes must
    prove it. `corpus`: example files in `tests/recording/corpus`, each with the options that read it.
    `magic`: possible first bytes, which no other format has. `no_magic`: if there are none, why; such a file
    is only recognised by its name or its content. `member`: file in an archive (.zip) that shows
    this format. `opener`: function that reads the file in this process, as MODULE:FUNCTION. `reader`:
    function that reads a path and a topic in a reader process, as MODULE:FUNCTION. `library`, `extra`:
    library that the reader needs, and the extra that installs it. `options`: fields of `How` that the user
    may set for this format. `pipe`: whether such a recording may come through a pipe.
    """

    title: str
    guide: str
    suffixes: tuple[str, ...]
    corpus: Mapping[str, str]
    magic: tuple[bytes, ...] = ()
    no_magic: str = ""
    member: str = ""
    opener: str = ""
    reader: str = ""
    library: str = ""
    extra: str = ""
    options: tuple[str, ...] = ALL
    pipe: bool = False
    is_certain: bool = True


def _each(names: str, options: str = "") -> dict[str, str]:
    return dict.fromkeys(names.split(), options)


FORMATS: Mapping[Kind, Format] = MappingProxyType(
    {
        "csv": Format(
            "text",
            "text: CSV of any kind (commas, `;`, tabs, blanks; decimal commas; UTF-8 or UTF-16), lines of "
            "JSON or with labels (also one label a line, as Teleplot's `>gx:1.2`), logs of ArduPilot as text "
            "(`.log`), YAML of `ros2 topic echo`, and what [loggers](#loggers) write",
            (".csv", ".txt", ".log", ".tsv", ".dat", ".gcsv", ".yaml", ".yml"),
            {
                **_each("plain.csv excel_dates.csv excel_unicode.txt iso_dates.csv us_dates.csv"),
                **_each("excel_seconds.csv", "--rate 100"),
                **_each("coarse_clock.csv", "--rate 7500"),
                **_each("esp32.txt arduino_monitor.txt", "--units dps"),
                **_each("plotter.txt", "--units dps --rate 100"),
                **_each("no_header.csv", "--columns 2,3,4 --time-column 1 --time-unit ms --units dps"),
                **_each(
                    "other_names.csv",
                    "--columns roll,pitch,yaw --time-column counter --time-unit ms --units dps",
                ),
            },
            no_magic=_ANY_TEXT,
            opener="fltea.recording.csv_file:open_csv",
            pipe=True,
        ),
        "compressed": Format(
            "a compressed file",
            "compressed by gzip, bzip2, xz or zip: text and what is written by other programs; of a `.zip` "
            "the file with the gyroscope",
            (".gz", ".bz2", ".xz", ".zip"),
            _each("plain.csv.gz plain.csv.bz2 plain.csv.xz"),
            magic=(b"\x1f\x8b", b"BZh", b"\xfd7zXZ", ZIP),
            opener="fltea.recording.compressed:open_compressed",
        ),
        "xlsx": Format(
            "Excel",
            "Excel",
            (".xlsx",),
            _each("phyphox.xlsx"),
            no_magic=_ZIP_ARCHIVE,
            member="xl/workbook.xml",
            reader="fltea.recording.readers.excel:read",
            library="openpyxl",
            extra="excel",
        ),
        "json": Format(
            "JSON",
            "JSON: objects or lists, in parts by their names, and what pandas writes",
            (".json",),
            _each("sensor_logger.json records.json"),
            no_magic=_ANY_TEXT,
            reader="fltea.recording.readers.json_document:read",
        ),
        "npy": Format(
            ".npy of numpy",
            "an array of numpy, a row a sample",
            (".npy",),
            _each("numpy.npy", "--units dps --rate 100"),
            magic=(b"\x93NUMPY",),
            opener="fltea.recording.npy_file:open_npy",
        ),
        "npz": Format(
            ".npz of fltea",
            "`gyro_raw` or `gyro_dps` with `fs_hz`, as `fltea export` writes them",
            (".npz",),
            _each("fltea.npz"),
            no_magic=_ZIP_ARCHIVE,
            opener="fltea.recording.npz_file:open_npz",
            options=(),
        ),
        "arrays": Format(
            ".npz of numpy",
            "other arrays of numpy's `savez`",
            (),
            _each("numpy.npz"),
            no_magic=_ZIP_ARCHIVE,
            reader="fltea.recording.readers.npz:read",
        ),
        "parquet": Format(
            "Parquet",
            "Parquet of pandas, polars and others",
            (".parquet", ".pq"),
            _each("pandas.parquet"),
            magic=(b"PAR1",),
            reader="fltea.recording.readers.arrow:read",
            library="pyarrow",
            extra="tables",
        ),
        "feather": Format(
            "Feather",
            "Feather and files of Arrow",
            (".feather", ".arrow"),
            _each("pandas.feather"),
            magic=(b"ARROW1",),
            reader="fltea.recording.readers.arrow:read",
            library="pyarrow",
            extra="tables",
        ),
        "hdf5": Format(
            "HDF5",
            "HDF5, also by pandas' `to_hdf`, and MATLAB's files since version 7.3",
            (".h5", ".hdf5", ".hdf"),
            _each("h5py.h5 pandas_fixed.h5 pandas_table.h5 matlab73.mat"),
            magic=(b"\x89HDF\r\n\x1a\n", b"MATLAB 7.3 MAT-file"),
            reader="fltea.recording.readers.hdf5:read",
            library="h5py",
            extra="hdf5",
        ),
        "mat": Format(
            "MATLAB",
            "MATLAB up to version 7.2: variables or a structure; `fs` may be the rate",
            (".mat",),
            _each("matlab.mat"),
            magic=(b"MATLAB 5.0 MAT-file",),
            reader="fltea.recording.readers.matlab:read",
            library="scipy",
            extra="matlab",
        ),
        "bag": Format(
            "a bag of ROS",
            "[bags of ROS](../cookbook/ros.md) 1 and 2, and `.mcap` with messages of JSON or protobuf",
            (".bag", ".active", ".db3", ".zstd"),
            _each("json.mcap protobuf.mcap", "--units rad/s"),
            magic=(b"#ROSBAG V", b"SQLite format 3\0"),
            opener="fltea.recording.ros_bag:open_bag",
            extra="ros",
            options=tuple(one for one in ALL if one not in ("columns", "time_column")),
        ),
        "ulg": Format(
            "PX4",
            "logs of PX4",
            (".ulg",),
            _each("px4.ulg"),
            magic=(b"ULog\x01\x12\x35",),
            reader="fltea.recording.readers.px4:read",
            library="pyulog",
            extra="px4",
        ),
        "ardupilot": Format(
            "ArduPilot",
            "logs of ArduPilot (DataFlash)",
            (".bin",),
            _each("ardupilot.bin"),
            magic=(b"\xa3\x95",),
            reader="fltea.recording.readers.ardupilot:read",
            library="pymavlink",
            extra="ardupilot",
            is_certain=False,
        ),
        "tdms": Format(
            "TDMS",
            "TDMS of LabVIEW",
            (".tdms",),
            _each("labview.tdms"),
            magic=(b"TDSm",),
            reader="fltea.recording.readers.tdms:read",
            library="nptdms",
            extra="tdms",
        ),
        "mf4": Format(
            "MF4",
            "MF4 (ASAM MDF) of measurements in vehicles",
            (".mf4", ".mdf"),
            _each("asam.mf4"),
            magic=(b"MDF     ", b"UnFinMF "),
            reader="fltea.recording.readers.mf4:read",
            library="asammdf",
            extra="mf4",
        ),
        "mcap": Format(
            "MCAP",
            "[recordings of fltea](outputs.md#recordings-in-mcap), a folder of them, the name of a session",
            (".mcap",),
            _each("fltea.mcap"),
            magic=(b"\x89MCAP",),
            extra="record",
            options=(),
        ),
        "ndjson": Format(
            "fltea's own output",
            "the output of `fltea run --samples`; a replay gives the live estimates bit for bit",
            (".ndjson", ".jsonl"),
            _each("fltea.ndjson"),
            no_magic=_ANY_TEXT,
            options=(),
            pipe=True,
        ),
    }
)


class Unread(NamedTuple):
    """A file format that is recognised but not read. Recognising it allows a message with advice.

    `what`: name of the format, and advice. `command`: command that converts the file, with {path} for the
    file's path. `guide`: name of the format in the guide. `magic`: bytes that such a file has at the offset
    `at`. `member`: file in an archive (.zip) that shows the format. `corpus`: example file.
    """

    what: str
    command: str
    magic: tuple[bytes, ...] = ()
    at: int = 0
    member: str = ""
    guide: str = ""
    corpus: str = ""

    def told(self, path: Path) -> str:
        """Return the message for the user about a file in this format."""
        command = self.command.format(path=shlex.quote(str(path)))
        return f"{path}: is {self.what}{': ' + command if command else '.'}"


_PANDAS = "python3 -c \"import pandas, sys; pandas.{}(sys.argv[1]).to_csv('imu.csv')\" {{path}}"
_TO_CSV = "libreoffice --headless --convert-to csv {path}"
_PICTURE = "a picture, which holds no samples. Export the numbers as CSV"

UNREAD = (
    Unread(
        "a Betaflight blackbox log. Its own program turns it into CSV, which is read",
        "blackbox_decode {path}",
        (b"H Product:Blackbox",),
        guide="Betaflight, INAV: blackbox",
        corpus="betaflight.bbl",
    ),
    Unread(
        "a file of an old Excel (.xls). Save it as .xlsx, or",
        _TO_CSV,
        (b"\xd0\xcf\x11\xe0",),
        guide="old Excel (`.xls`)",
        corpus="old_excel.xls",
    ),
    Unread(
        "a file of LibreOffice (.ods). Save it as .xlsx or CSV",
        _TO_CSV,
        member="content.xml",
        guide="LibreOffice (`.ods`)",
    ),
    Unread(
        "a text of Word. Copy its table into Excel, and save it as .xlsx or CSV",
        "",
        member="word/document.xml",
    ),
    Unread(
        "a Feather file of the first version. pandas writes one that is read",
        _PANDAS.format("read_feather"),
        (b"FEA1",),
    ),
    Unread(
        "a pickle of Python. Opening one runs whatever it says, so fltea never does. If it is a table of "
        "pandas and you trust it, turn it into CSV",
        _PANDAS.format("read_pickle"),
        (b"\x80\x02", b"\x80\x03", b"\x80\x04\x95", b"\x80\x05\x95"),
        guide="a pickle of pandas that you trust",
    ),
    Unread(
        "compressed by zstd. Decompress it", "zstd -d {path}", (b"(\xb5/\xfd",), guide="compressed by zstd"
    ),
    Unread("an archive of 7-Zip. Decompress it", "7z x {path}", (b"7z\xbc\xaf\x27\x1c",), guide="`.7z`"),
    Unread("an archive of RAR. Decompress it", "unrar x {path}", (b"Rar!",), guide="`.rar`"),
    Unread(
        "an archive of tar. Decompress it, and name the file of the gyroscope",
        "tar -xf {path}",
        (b"ustar",),
        257,
        guide="`.tar`",
    ),
    Unread("a PDF, which holds no samples. Export the numbers as CSV", "", (b"%PDF",)),
    Unread(_PICTURE, "", (b"\x89PNG", b"\xff\xd8\xff")),
    Unread("a sound or a film, which holds no samples of a gyroscope", "", (b"RIFF",)),
    Unread("a program", "", (b"\x7fELF",)),
    Unread(
        "a log of Xsens. Export it as text in MT Manager, with rates and SampleTimeFine", "", (b"\xfa\xff",)
    ),
)

KINDS: Mapping[str, Kind] = {suffix: kind for kind, one in FORMATS.items() for suffix in one.suffixes}
"""Format for each ending of a file's name. For .mcap, the file's content decides whether it is from ROS or
fltea.
"""

MAGIC: Mapping[bytes, Kind] = {begin: kind for kind, one in FORMATS.items() for begin in one.magic}

ENDINGS = f"text ({', '.join(FORMATS['csv'].suffixes)}), compressed or not; " + ", ".join(
    suffix for suffix, kind in KINDS.items() if kind not in ("csv", "compressed")
)
"""Endings of the names of files that are read, for help texts."""


def loaded(name: str) -> Any:
    """Import a module and return an attribute of it, such as a reader. `name`: MODULE:ATTRIBUTE."""
    module, _, function = name.partition(":")
    return getattr(importlib.import_module(module), function)
