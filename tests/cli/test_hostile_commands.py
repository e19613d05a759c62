"""Tests of malicious command lines and files: they give an exit code and a message, never a traceback.

Every option of every command, and every setting by --set, is tried with hostile words from the list `WORDS`.
"""

import os
import random
import stat
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main
from fltea.cli import fleet
from fltea.cli.app import app
from fltea.machine import flash
from fltea.recording.formats import KINDS
from fltea.records import small_file
from fltea.records.errors import FlteaError, UsageError, of_input
from fltea.settings.config import SETTINGS

from tests.rig.host_support import fltea, fltea_here
from tests.rig.hostile_words import OTHER, STRANGE, WORDS

COMMANDS = typer.main.get_command(app).commands
FAST = ["run", "--once", "--format", "none", "--startup", "50"]
BASES = {
    "run": [*FAST, "-s", "replay:rest.npz"],
    "run live": [*FAST, "--pace", "fast", "-s", "synthetic:?n=120"],
    "identify": ["identify", "--shuffles", "0", "--jobs", "1", "rest.npz"],
    "record": ["record", "-s", "synthetic:?n=100", "--for", "0.1", "recordings"],
    "info": ["info", "rest.npz"],
    "export": ["export", "rest.npz", "--to", "out.npz", "--force"],
    "recover": ["recover", "rest.mcap"],
    "doctor": ["doctor", "--source", "replay:rest.npz"],
    "flash": ["flash", "--dry-run", "--method", "bossac", "--erase-unknown-board", "--port", "/dev/null"],
    "fleet": ["fleet", "--mqtt", "127.0.0.1:1", "--json"],
    "inspect": ["inspect", "rest.npz"],
    "simulate": ["simulate", "out.csv", "-n", "20", "--window", "20", "--force"],
    "reproduce": ["reproduce", "--table", "9"],
    "bench": ["bench", "--repetitions", "1"],
}
TEXTS: dict[str, bytes] = {
    "deep array": b"a = " + b"[" * 200_000,
    "deep table": b"[" + b"a." * 5_000 + b"a]\n",
    "a key of many parts": b"a" + b".a" * 120_000 + b" = 1",
    "quoted parts": b"''" + b".''" * 80_000 + b" = 1",
    "a table within many": b"[" + b"a." * 60_000 + b"a]\n" + b"b.b = 1\n" * 15_000,
    "a key in a table in a line": b'a = {b = """\n#""""' + b", c" + b".c" * 120_000 + b" = 1}",
    "deep JSON": b"[" * 500_000,
    "deep objects": b'{"a":' * 200_000,
    "digits": b"[link]\nbaud = " + b"9" * 6000,
    "hexadecimal digits": b"[replay]\nrate_hz = 0x" + b"f" * 6000,
    "digits of JSON": b'{"version":' + b"9" * 6000 + b',"devices":{}}',
    "a NUL in a path": b'[record]\nfolder = "a\\u0000b"',
    "a NUL in the state's": b'[state]\nfile = "a\\u0000b"',
    "a NUL in a port's": b'source = "serial:a\\u0000b"',
    "a device without a table": b"[device]\nx = 1",
    "any bytes": bytes(range(256)),
    "NULs": bytes(1000),
    "other letters": "name = 'x'".encode("utf-16"),
    "nothing": b"",
}
NAMES = ["folder", "loop", "sparse", "pipe", "\udcff", "x" * 300, "a\0b", "none"]
IDENTIFY = BASES["identify"]
WHOLE = {
    "settings": [*BASES["run live"], "-c"],
    "settings of a fleet": ["fleet", "--json", "-c"],
    "state": [*FAST, "--pace", "fast", "-s", "synthetic:?n=60", "--state"],
    "model": ["simulate", "out.csv", "-n", "10", "--force", "--model"],
    "password": ["fleet", "--mqtt", "127.0.0.1:1", "--listen", "0", "--password-file"],
    "image": [
        "flash",
        "--dry-run",
        "--method",
        "bossac",
        "--erase-unknown-board",
        "--port",
        "/dev/null",
        "--image",
    ],
}
"""For each kind of file that is read as a whole (not as a stream), a command that reads it."""


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fleet, "FIRST_S", 0.05)
    monkeypatch.setattr(small_file, "PATIENCE_S", 0.05)
    monkeypatch.setattr(fleet, "_serve", lambda running, *_: running.close())
    monkeypatch.setattr(flash, "_bossac", lambda: "/bin/true")
    counts = np.random.default_rng(1).integers(-50, 50, (120, 3)).astype(np.int16)
    np.savez("rest.npz", gyro_raw=counts, fs_hz=100.0, lsb_per_dps=16.4)
    Path("folder").mkdir()
    Path("loop").symlink_to("loop")
    restore()
    with Path("sparse").open("wb") as file:
        file.truncate(50_000_000_000)


def put(kind: str, name: str) -> None:
    """Put a pipe or a link at a name, as `STRANGE` describes them, in place of what is there."""
    Path(name).unlink(missing_ok=True)
    Path("other").write_text(OTHER)
    if kind == "pipe":
        os.mkfifo(name)
    else:
        Path(name).symlink_to(Path("other" if kind == "link" else "nobody").absolute())


def restore() -> None:
    """Put the pipe and the links back, since an earlier command may have replaced a link by a file."""
    for kind in STRANGE:
        put(kind, kind)


def lines() -> list[list[str]]:
    found = []
    for base in BASES.values():
        for parameter in COMMANDS[base[0]].params:
            if parameter.param_type_name == "argument":
                found += [[*base, *(["--"] if word.startswith("-") else []), word] for word in WORDS]
            elif not parameter.is_flag:
                flag = max(parameter.opts, key=len)
                found += [[*base, f"{flag}={word}"] for word in WORDS]
    for path in SETTINGS:
        found += [[*BASES[name], "--set", f"{path}={word}"] for name in ("run", "run live") for word in WORDS]
    return found


def is_live(line: list[str]) -> bool:
    """Return whether the arguments let fltea read lines of text from the pipe as they come.

    Then fltea waits for a program that writes to the pipe, and says so after 5 s.
    """
    return line[0] in ("run", "record") and line[-1] in ("--source=pipe", "source=pipe")


def check(line: list[str], codes: tuple[int, ...] = (0, 1, 2)) -> str:
    said = "\n".join(word[:80] for word in line).encode("utf-8", "backslashreplace").decode()
    try:
        done = fltea_here(*line)
    except Exception as error:
        raise AssertionError(said) from error
    assert done.returncode in codes, said + done.stderr
    assert "Traceback" not in done.stderr, said
    assert "Warning" not in done.stderr, said
    assert done.returncode == 0 or done.stderr or done.stdout, said
    assert Path("other").read_text() == OTHER, said
    assert not Path("nobody").exists(), said
    assert Path("pipe").is_fifo(), said
    return done.stderr


@pytest.mark.slow
def test_options_take_any_word() -> None:
    for line in random.Random(150).sample(lines(), 75):
        if not is_live(line):
            restore()
            check(line)


PARTS = 4


@pytest.mark.long
@pytest.mark.parametrize("part", range(PARTS))
def test_every_option_takes_words_of_each_kind(part: int) -> None:
    """Each option is tried with three words. They lie a third of the list `WORDS` apart, so that they are of
    different kinds. For the next option, each of the three is the next word in the list. So all words are
    used about equally often.
    """
    found, n = lines(), len(WORDS)
    of_an_option = [found[k : k + n] for k in range(0, len(found), n)]
    for place, some in list(enumerate(of_an_option))[part::PARTS]:
        for third in range(3):
            line = some[(place + third * n // 3) % n]
            if not is_live(line):
                restore()
                check(line)


@pytest.mark.parametrize("kind", WHOLE)
def test_a_file_that_is_read_whole_may_hold_anything(kind: str) -> None:
    for name, data in TEXTS.items():
        file = Path(name)
        file.write_bytes(data)
        file.chmod(0o600)
        of_power_cut = kind == "state" and name in ("nothing", "NULs")
        harmless = kind == "password" or of_power_cut or (name == "nothing" and "settings" in kind)
        text = check([*WHOLE[kind], name], (0, 1, 2) if harmless else (2,))
        assert "python -X dev" not in text, text


@pytest.mark.parametrize("kind", WHOLE)
def test_a_file_that_is_read_whole_may_be_anything(kind: str) -> None:
    for name in [*NAMES, *([] if kind == "state" else ["/dev/zero"])]:
        text = check(
            [*WHOLE[kind], name], (0, 2) if (kind, name) in (("state", "none"), ("state", "\udcff")) else (2,)
        )
        assert len(text) < 1000


WRITES = {
    "simulate": (["simulate", "out.csv", "-n", "20", "--window", "20", "--force"], ["out.csv"]),
    "export": (["export", "rest.npz", "--to", "out.npz", "--force"], ["out.npz"]),
    "run": ([*FAST, "--pace", "fast", "-s", "synthetic:?n=120", "--state", "state"], ["state"]),
    "record": (["record", "-s", "synthetic:?n=100", "--for", "0.1", "kept"], ["kept/*.mcap"]),
}
"""For each command that writes files, its arguments and the files that it creates."""


READS = {
    "info": ["info", "NAME"],
    "identify": [*IDENTIFY, "NAME"],
    "export": ["export", "NAME", "--to", "out.csv"],
    "recover": ["recover", "NAME"],
    "run": [*FAST, "-s", "replay:NAME"],
}
"""For each command that reads recordings, its arguments, where NAME stands for the recording."""


@pytest.mark.parametrize(
    ("command", "kind"),
    [
        ("info", "link to none"),
        ("info", "pipe"),
        *(pytest.param(one, "pipe", marks=pytest.mark.slow) for one in READS if one != "info"),
    ],
)
def test_recordings_that_are_pipes_or_broken_links_are_refused(command: str, kind: str) -> None:
    """A pipe to which nobody writes is not waited for without an end."""
    for ending in (*KINDS, ".db3.zstd", ".csv.gz", ".zip"):
        name = f"a{ending}"
        put(kind, name)
        check([word.replace("NAME", name) for word in READS[command]], (1, 2))


REPLACED = {
    "--export-model": ([*IDENTIFY, "--export-model", "m.json"], "m.json"),
    "--imu-yaml": ([*IDENTIFY, "--imu-yaml", "imu.yaml"], "imu.yaml"),
    "--allan-csv": ([*IDENTIFY, "--allan-csv", "a.csv"], "a.csv"),
    "a file of --report": ([*IDENTIFY, "--report", "folder"], "folder/report.html"),
    "simulate": (["simulate", "out.csv", "-n", "20", "--window", "20", "--force"], "out.csv"),
    "--to": (["export", "rest.npz", "--to", "out.npz", "--force"], "out.npz"),
    "--to as CSV": (["export", "rest.npz", "--to", "out.csv", "--force"], "out.csv"),
    "--export": (["fleet", "--history", "old.db", "--export", "fits.parquet"], "fits.parquet"),
}
REFUSED = {
    "--report": ([*IDENTIFY, "--report", "report"], "report"),
    "--out": ([*IDENTIFY, "--out", "v.parquet"], "v.parquet"),
    "record": (["record", "-s", "synthetic:?n=100", "--for", "0.1", "kept"], "kept"),
    "--record": ([*FAST, "-s", "synthetic:?n=100", "--record", "kept"], "kept"),
    "--state": ([*FAST, "--pace", "fast", "-s", "synthetic:?n=60", "--state", "state"], "state"),
    "its lock": ([*FAST, "--pace", "fast", "-s", "synthetic:?n=60", "--state", "state"], ".state.lock"),
    "--history": ([*BASES["fleet"], "--history", "fleet.db"], "fleet.db"),
}
"""REPLACED and REFUSED have, for each option that names an output file, a command with this option, and the
name of the file. At this name, a test puts a pipe or a link before it runs the command.

The commands in REPLACED replace a link by the output file. The commands in REFUSED refuse a link.
"""


@pytest.mark.parametrize("option", REPLACED | REFUSED)
def test_what_is_written_follows_no_link_and_waits_for_no_pipe(option: str) -> None:
    line, name = (REPLACED | REFUSED)[option]
    counts = np.random.default_rng(1).integers(-50, 50, (700, 3)).astype(np.int16)
    np.savez("rest.npz", gyro_raw=counts, fs_hz=100.0, lsb_per_dps=16.4)
    if option == "--export":
        check([*BASES["fleet"], "--history", "old.db"], (1,))
    for kind in STRANGE:
        put(kind, name)
        is_replaced = kind != "pipe" and option in REPLACED
        check(line, (0,) if is_replaced else (1, 2))
        assert Path(name).is_symlink() == (kind != "pipe" and not is_replaced)
        assert Path(name).is_fifo() == (kind == "pipe")


@pytest.mark.parametrize("name", ["fleet.db-wal", "fleet.db-shm", "fleet.db-journal"])
def test_files_of_sqlite_follow_no_link_and_wait_for_no_pipe(name: str) -> None:
    for kind in STRANGE:
        put(kind, name)
        check([*BASES["fleet"], "--history", "fleet.db"], (1, 2))


@pytest.mark.parametrize("umask", [0o000, 0o027, 0o077], ids=oct)
def test_files_have_the_rights_that_the_umask_leaves(umask: int) -> None:
    """Files have all permissions that the umask allows, and no others."""
    before = os.umask(umask)
    try:
        for command, _ in WRITES.values():
            check(command, (0,))
    finally:
        os.umask(before)
    for _, names in WRITES.values():
        found = [path for name in names for path in Path().glob(name)]
        assert found
        assert {stat.S_IMODE(path.stat().st_mode) for path in found} == {0o666 & ~umask}


def test_a_real_process_says_it_too() -> None:
    for line in (
        ["info", "\udcff.csv"],
        ["info", "x" * 300],
        ["run", "-c", "/dev/zero"],
        ["bench", "\udcff"],
    ):
        done = fltea(*line)
        assert (done.returncode, "Traceback" in done.stderr) == (2, False), done.stderr


@pytest.mark.parametrize(
    ("error", "kind", "words"),
    [
        (RecursionError("maximum"), UsageError, "nested too deeply"),
        (UnicodeEncodeError("utf-8", "\udcff", 0, 1, "surrogates"), UsageError, "not UTF-8"),
        (FileNotFoundError(2, "No such file", "x" * 5000), UsageError, "No such file: xxx"),
        (OSError(28, "No space left", "out"), FlteaError, "the program needs: No space left: out"),
        (OSError(37, "No locks available"), FlteaError, "the file system has no locks"),
        (OverflowError("too large"), UsageError, "too large"),
        (TypeError("ours"), None, ""),
        (AssertionError(), None, ""),
    ],
)
def test_what_input_causes_is_told_from_faults_of_the_program(
    error: Exception, kind: Any, words: str
) -> None:
    found = of_input(error)
    assert (None if found is None else type(found)) is kind
    assert words in str(found)
    assert len(str(found)) < 600
