"""The tables of formats and dialects are complete: each row has an example file, the extra that installs its
library, and an entry in the documentation.
"""

import fnmatch
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from fltea.recording.dialects import dialects
from fltea.recording.formats import ALL, FORMATS, KINDS, MAGIC, UNREAD, Unread, loaded
from fltea.recording.kind import open_one_file
from fltea.records.errors import UsageError
from fltea.records.records import Hello
from fltea.settings.how import How
from fltea.sources.replay import ReplaySource

from tests.rig.corpus_files import HERE

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "host/docs/guide/files.md").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CORPUS = {path.name for path in HERE.iterdir()} - {"README.md"}

WITHOUT_MAGIC = {
    **dict.fromkeys(("csv", "json", "ndjson"), "text may begin with anything"),
    **dict.fromkeys(("xlsx", "npz", "arrays"), "a zip archive, which its members tell from others"),
}
"""Formats that have no fixed first bytes, and why."""

formats = pytest.mark.parametrize("kind", FORMATS)


@formats
def test_each_format_has_a_file_of_it(kind: str) -> None:
    assert FORMATS[kind].corpus
    for name in FORMATS[kind].corpus:
        opened = open_one_file(HERE / name)
        assert opened.kind == ("bag" if kind == "mcap" else kind), name
        if FORMATS[kind].magic:
            assert (HERE / name).read_bytes().startswith(tuple(MAGIC)), f"{name} begins otherwise"


@formats
def test_each_format_is_in_the_documents(kind: str) -> None:
    form = FORMATS[kind]
    (row,) = [line for line in PAGE.splitlines() if line.startswith(f"| {form.guide}")]
    assert all(f"`{suffix}`" in row for suffix in form.suffixes)
    assert not form.extra or row.endswith(f"| `{form.extra}` |")


@formats
def test_each_format_has_a_reader_and_each_library_an_extra(kind: str) -> None:
    form = FORMATS[kind]
    assert set(form.options) <= set(ALL)
    if kind not in ("mcap", "ndjson"):
        assert callable(loaded(form.reader or form.opener))
        assert not (form.reader and form.opener)
    extras = PROJECT["optional-dependencies"]
    assert bool(form.library) == bool(form.reader and form.extra), "who lacks the package is not told of it"
    if form.library:
        packages = " ".join(extras[form.extra]).lower()
        assert re.search(rf"\b{form.library}\b", packages)
    if form.extra:
        (every,) = extras["files"]
        assert form.extra in re.findall(r"\w+", every)


@formats
def test_each_format_states_its_first_bytes(kind: str) -> None:
    """Without them, a file is recognised by its name only, and a renamed file is read as text."""
    stated = bool(FORMATS[kind].magic)
    assert stated != (kind in WITHOUT_MAGIC), f"formats.py: {kind} needs its first bytes as `magic`"


def test_no_ending_and_no_beginning_is_of_two_formats() -> None:
    endings = [suffix for one in FORMATS.values() for suffix in one.suffixes]
    begins = [begin for table in (FORMATS.values(), UNREAD) for one in table for begin in one.magic]
    assert len(endings) == len(KINDS)
    assert [(a, b) for a in begins for b in begins if a is not b and a.startswith(b)] == []
    assert set(How.__struct_fields__) == set(ALL)
    assert set(MAGIC) <= set(begins)


def test_each_dialect_has_a_file_and_is_in_the_documents() -> None:
    for one in dialects():
        assert one.corpus, one.name
        assert set(one.corpus) <= CORPUS, one.name
        assert one.docs, one.name
        assert f"| {one.guide} |" in PAGE, one.name


def test_each_file_is_of_a_format_or_a_dialect() -> None:
    named = {name for table in (FORMATS.values(), dialects()) for one in table for name in one.corpus}
    assert CORPUS - named - {one.corpus for one in UNREAD} == set()


@formats
def test_each_file_of_a_format_is_in_the_readme_of_the_corpus(kind: str) -> None:
    told = re.findall(r"`([^`]+)`", (HERE / "README.md").read_text().partition("The others:")[2])
    patterns = [f"*{one}" if one.startswith(".") else one for one in told]
    of_dialects = {name for one in dialects() for name in one.corpus}
    for name in set(FORMATS[kind].corpus) - of_dialects:
        assert any(fnmatch.fnmatch(name, pattern) for pattern in patterns), name


@pytest.mark.parametrize("one", UNREAD, ids=lambda one: one.what[:20])
def test_what_is_known_and_not_read_is_called_by_its_name(one: Unread, tmp_path: Path) -> None:
    paths = [HERE / one.corpus] if one.corpus else []
    for k, magic in enumerate(one.magic):
        paths.append(tmp_path / f"rest {k}.log")
        paths[-1].write_bytes(bytes(one.at) + magic + bytes(64))
    if one.member:
        paths.append(tmp_path / "rest.odd")
        with zipfile.ZipFile(paths[-1], "w") as archive:
            archive.writestr(one.member, "<a/>")
    for path in paths:
        with pytest.raises(UsageError) as caught:
            open_one_file(path)
        assert str(caught.value) == one.told(path)
    assert not one.guide or f"| {one.guide} | `{one.command.format(path='FILE')}`" in PAGE


@pytest.mark.parametrize("suffix", sorted({*KINDS, ".csv.gz", ".odd"} - {".mcap", ".ndjson", ".jsonl"}))
def test_rows_of_numbers_are_text_whatever_the_name_says(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"rest{suffix}"
    path.write_text("time_s,gx_dps,gy_dps,gz_dps\n" + "".join(f"{k / 100},1,2,{k % 3}\n" for k in range(50)))
    assert open_one_file(path).kind == "csv"
    found = ReplaySource(path).events()
    assert next(one for one in found if isinstance(one, Hello)).rate_hz == pytest.approx(100.0)


def test_what_begins_as_a_document_in_a_file_is_not_called_a_stream(tmp_path: Path) -> None:
    path = tmp_path / "rest.txt"
    path.write_text("[[[{(1,2,3\n" * 50)
    with pytest.raises(
        UsageError, match=r"begins like one JSON document. Such a file is read if its name ends"
    ):
        ReplaySource(path)


def test_the_table_is_cheap_to_load() -> None:
    """Help texts list the endings of file names of all formats, so each start of the program loads the table
    of formats. This must not load numpy or a format's library.

    On a Raspberry Pi, the start already takes a second.
    """
    program = "import sys; from fltea.recording import formats; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert {"numpy", "h5py", "pyarrow", "fltea.recording.kind"} & {*done.stdout.split()} == set()
