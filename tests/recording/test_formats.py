"""The tables of formats and dialects are complete: each row has an example file, the extra that installs its
library, and an entry in the documentation.
"""

import ast
import fnmatch
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
from fltea.recording.dialects import dialects
from fltea.recording.formats import ALL, FORMATS, KINDS, MAGIC, UNREAD, Unread
from fltea.recording.kind import open_one_file
from fltea.records.errors import UsageError
from fltea.records.records import Hello
from fltea.settings.how import How
from fltea.sources.replay import ReplaySource

from tests.rig.corpus_files import HERE

ROOT = Path(__file__).parents[2]
TABLE = "host/fltea/recording/formats.py"
GUIDE = "host/docs/guide/files.md"
EXAMPLES = "tests/recording/corpus"
PAGE = (ROOT / GUIDE).read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CORPUS = {path.name for path in HERE.iterdir()} - {"README.md"}

formats = pytest.mark.parametrize("kind", FORMATS)


@formats
def test_each_format_has_a_file_of_it(kind: str) -> None:
    form = FORMATS[kind]
    assert form.corpus, f"{TABLE}: {kind} needs an example of {EXAMPLES} in `corpus`"
    for name in form.corpus:
        assert name in CORPUS, f"{EXAMPLES}/{name}: is missing; `python -m tests.rig.corpus_files` writes it"
        assert Path(name).suffix in KINDS, f"{TABLE}: `suffixes` of {kind} lacks the ending of {name}"
        opened = open_one_file(HERE / name)
        assert opened.kind == ("bag" if kind == "mcap" else kind), (
            f"{TABLE}: {name} is opened as {opened.kind}: `suffixes`, `magic` or `member` of {kind} is wrong"
        )
        if form.magic:
            assert (HERE / name).read_bytes().startswith(tuple(MAGIC)), (
                f"{TABLE}: {name} begins with none of `magic` of {kind}"
            )


@formats
def test_each_format_is_in_the_documents(kind: str) -> None:
    form = FORMATS[kind]
    rows = [line for line in PAGE.splitlines() if line.startswith(f"| {form.guide}")]
    assert len(rows) == 1, f"{GUIDE}: {len(rows)} rows begin with {form.guide!r}, not one: run `make gen`"
    lacks = [suffix for suffix in form.suffixes if f"`{suffix}`" not in rows[0]]
    assert not lacks, f"{GUIDE}: the row of {form.title} lacks {lacks}: run `make gen`"
    assert not form.extra or rows[0].endswith(f"| `{form.extra}` |"), (
        f"{GUIDE}: the row of {form.title} does not end with the extra {form.extra}: run `make gen`"
    )


def test_the_number_of_formats_is_that_of_the_table() -> None:
    (said,) = re.findall(r"files of (\d+) formats", (ROOT / "README.md").read_text())
    assert int(said) == len(FORMATS), f"README.md: files of {said} formats, and {TABLE} has {len(FORMATS)}"


@formats
def test_each_format_has_a_reader(kind: str) -> None:
    form = FORMATS[kind]
    assert set(form.options) <= set(ALL), f"{TABLE}: `options` of {kind} are no fields of `How`"
    if kind not in ("mcap", "ndjson"):
        assert form.reader or form.opener, f"{TABLE}: {kind} needs a `reader` (or an `opener`)"
        assert not (form.reader and form.opener), f"{TABLE}: {kind} has a `reader` and an `opener`"
        module, _, function = (form.reader or form.opener).partition(":")
        assert find_spec(module), f"{TABLE}: {kind} names the module {module}, which is missing"
        assert hasattr(import_module(module), function), (
            f"{TABLE}: {kind} names {function} in {module}, which is missing"
        )


def test_each_reader_is_of_a_format() -> None:
    read_by = {form.reader.partition(":")[0].rpartition(".")[2] for form in FORMATS.values()}
    for path in (ROOT / "host/fltea/recording/readers").glob("*.py"):
        is_reader = "\ndef read(" in path.read_text()
        assert not is_reader or path.stem in read_by, f"{TABLE}: no row's `reader` is {path.stem}:read"


@formats
def test_each_library_that_a_reader_imports_is_in_the_table(kind: str) -> None:
    module = FORMATS[kind].reader.partition(":")[0]
    if not module:
        return
    tree = ast.parse((ROOT / f"host/{module.replace('.', '/')}.py").read_text())
    names = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    names += [one.name for node in ast.walk(tree) if isinstance(node, ast.Import) for one in node.names]
    always = {
        "fltea",
        *sys.stdlib_module_names,
        *re.findall(r"^\w+", "\n".join(PROJECT["dependencies"]), re.M),
    }
    others = {name.partition(".")[0] for name in names} - always
    assert others <= {FORMATS[kind].library}, (
        f"{TABLE}: `library` of {kind} is not {others}, which it imports"
    )


@formats
def test_each_library_has_an_extra(kind: str) -> None:
    form, extras = FORMATS[kind], PROJECT["optional-dependencies"]
    assert bool(form.library) == bool(form.reader and form.extra), (
        f"{TABLE}: {kind} has `library` or `extra` alone, so who lacks the package is not told of it"
    )
    if form.extra:
        assert form.extra in extras, f"pyproject.toml: there is no extra {form.extra}, which {kind} needs"
        (every,) = extras["files"]
        assert form.extra in re.findall(r"\w+", every), f"pyproject.toml: the extra files lacks {form.extra}"
    if form.library:
        packages = " ".join(extras[form.extra]).lower()
        assert re.search(rf"\b{form.library}\b", packages), (
            f"pyproject.toml: the extra {form.extra} lacks {form.library}, which {kind} needs"
        )


@formats
def test_each_format_states_its_first_bytes(kind: str) -> None:
    """Without them, a file is recognised by its name only, and a renamed file is read as text."""
    assert bool(FORMATS[kind].magic) != bool(FORMATS[kind].no_magic), (
        f"{TABLE}: {kind} needs either its first bytes as `magic`, or as `no_magic` why it has none"
    )


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
    forgotten = CORPUS - named - {one.corpus for one in UNREAD}
    assert not forgotten, f"{TABLE}: no row's `corpus`, and no dialect's, names {forgotten} of {EXAMPLES}"


@formats
def test_each_file_of_a_format_is_in_the_readme_of_the_corpus(kind: str) -> None:
    told = re.findall(r"`([^`]+)`", (HERE / "README.md").read_text().partition("The others:")[2])
    patterns = [f"*{one}" if one.startswith(".") else one for one in told]
    of_dialects = {name for one in dialects() for name in one.corpus}
    for name in set(FORMATS[kind].corpus) - of_dialects:
        assert any(fnmatch.fnmatch(name, pattern) for pattern in patterns), (
            f"{EXAMPLES}/README.md: no line of the last table says what writes {name}"
        )


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
