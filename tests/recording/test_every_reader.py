"""Tests the reader of every format on an example of `tests/rig/corpus_files.py`: files that are cut off or
damaged, missing values, and how the work grows with the number of rows.

The readers run in this process, so that the tests see their exceptions. The reader process that the program
starts would turn every exception into an error.
"""

import gc
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from fltea.recording.files import Stored
from fltea.recording.formats import FORMATS

from tests.rig.corpus_files import EXAMPLES, HERE, Columns, Example, N
from tests.rig.counted_work import Work, work_of
from tests.rig.table_support import stored_here
from tests.rig.tiers import long, slow

pytestmark = pytest.mark.filterwarnings("ignore")
"""Ignores warnings of libraries, and files left open. In the program, readers run in a process of their own:
it discards the warnings, and its end closes the files.
"""

READ = [kind for kind, form in FORMATS.items() if form.reader]
WITH_EXAMPLE = [kind for kind in READ if kind in EXAMPLES]
readers = pytest.mark.parametrize("kind", WITH_EXAMPLE)

CUTS = (0.1, 0.3, 0.5, 0.7, 0.9, 0.97)
"""Places at which a file is cut off, as parts of its length."""
LAST = (1, 3, 7, 20)
"""Numbers of bytes that a file lacks at its end."""
PLACES = 12
"""Number of places at which a file is damaged, evenly over its length."""
DAMAGES = ((b"\xff" * 12, 12), (b"\xc1", 1), (bytes(30), 30), (b"", 5))
"""Damages: the bytes that are written at a place, and how many bytes they replace."""

MISSING_ROW = 5
SIZES = (8, 16, 32)
"""How many times the rows of the example are repeated to count the work."""
MOST_MORE = {"calls": 300, "made_bytes": 300_000}
"""If the rows are doubled twice, the second doubling may take 2.1 times the work of the first, and this much
more.
"""


@pytest.fixture(autouse=True, scope="module")
def closed_files() -> Iterator[None]:
    """Close at once the files that readers left open, and not in the middle of another test."""
    yield
    gc.collect()


@pytest.mark.parametrize("kind", READ)
def test_each_reader_has_an_example(kind: str) -> None:
    assert kind in EXAMPLES, f"tests/rig/corpus_files.py: EXAMPLES has no row for {kind}, so little tests it"
    assert EXAMPLES[kind].file in FORMATS[kind].corpus, (
        f"host/fltea/recording/formats.py: `corpus` of {kind} lacks {EXAMPLES[kind].file}, its example"
    )


class Found(NamedTuple):
    """What is read of a file. `counted`: number of rows, and of rows that the result says were lost between
    them.
    """

    stored: Stored
    counted: int


def found_in(path: Path) -> Found | None:
    """Read a file. Return None if it is refused, for whatever reason."""
    try:
        stored = stored_here(path)
        seq = stored.whole().seq
    except Exception:  # libraries raise various errors for damaged bytes
        return None
    return Found(stored, stored.samples if seq is None else int(seq[-1] + 1))


def changed(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield damaged files, and where they are damaged."""
    for place in range(PLACES):
        at = (2 * place + 1) * len(data) // (2 * PLACES)
        for put, gone in DAMAGES:
            yield f"{put!r} at byte {at}", data[:at] + put + data[at + gone :]


@readers
def test_a_cut_file_is_refused_or_noted(kind: str, tmp_path: Path) -> None:
    """Each file is cut off at a place, and again one byte earlier. The reader has to notice one of the two
    cuts.

    A file that consists of messages may be cut between two of them. The rest is then a whole file, so nothing
    can show this cut.
    """
    example = EXAMPLES[kind]
    data = (HERE / example.file).read_bytes()
    whole = stored_here(HERE / example.file)
    gyro = whole.whole().gyro
    assert not whole.notes, (
        f"{example.file}: a note about the whole example would hide that none tells of a cut"
    )
    silent = []
    for place in [*(int(part * len(data)) for part in CUTS), *(len(data) - lacking for lacking in LAST)]:
        told = []
        for end in (place, place - 1):
            path = tmp_path / f"{end}{Path(example.file).suffix}"
            path.write_bytes(data[:end])
            found = found_in(path)
            is_silent = found is not None and not found.stored.notes
            told.append(not (found and is_silent) or np.array_equal(found.stored.whole().gyro, gyro))
        silent += [] if any(told) else [f"at byte {place}"]
    assert not silent, f"{FORMATS[kind].reader}: no note or error tells that the file is cut off: {silent}"


@pytest.mark.parametrize("kind", [long(one) if one == "mf4" else one for one in WITH_EXAMPLE])
def test_no_row_of_a_damaged_file_vanishes_in_silence(kind: str, tmp_path: Path) -> None:
    example = EXAMPLES[kind]
    silent = []
    for number, (where, data) in enumerate(changed((HERE / example.file).read_bytes())):
        path = tmp_path / f"{number}{Path(example.file).suffix}"
        path.write_bytes(data)
        found = found_in(path)
        if found is not None and not found.stored.notes and found.counted < N:
            silent.append(f"{where}: {found.counted} of {N} rows")
    assert not silent, f"{FORMATS[kind].reader}: no note, error or count tells of lost rows: {silent}"


@readers
def test_a_missing_value_is_counted(kind: str, tmp_path: Path) -> None:
    example = EXAMPLES[kind]
    path = tmp_path / example.file
    columns = with_missing(example)
    if example.never_missing:
        return
    example.write(path, columns)
    stored = stored_here(path)
    whole = stored.whole()
    truth = np.delete(stored_here(HERE / example.file).whole().gyro, MISSING_ROW, axis=0)
    assert whole.gyro == pytest.approx(truth), f"{FORMATS[kind].reader}: a missing value changes other rows"
    assert whole.seq is not None
    assert [*whole.seq] == [k for k in range(N) if k != MISSING_ROW]
    assert [note.kind for note in stored.notes] == ["missing_numbers"]


def with_missing(example: Example) -> Columns:
    """Return the columns of an example in which one number of the gyroscope is missing."""
    gyro = np.array(example.columns[example.gyro])
    gyro.reshape(N, -1)[MISSING_ROW, -1] = np.nan
    return {**example.columns, example.gyro: gyro}


def repeated(columns: Columns, times: int) -> Columns:
    """Return columns in which all rows are repeated. Columns that rise evenly, such as times, rise on."""
    found: dict[str, Any] = {}
    for name, values in columns.items():
        array = np.asarray(values)
        steps = np.diff(array) if array.ndim == 1 and array.dtype.kind in "iufM" else np.zeros(1)
        is_clock = bool((steps > np.zeros(1, steps.dtype)).all())
        rise = [k * len(array) * steps[0] if is_clock else 0 for k in range(times if array.ndim else 0)]
        found[name] = np.concatenate([array + one if is_clock else array for one in rise]) if rise else values
    return found


@pytest.mark.parametrize("kind", [slow(one) if one == "xlsx" else one for one in WITH_EXAMPLE])
def test_twice_the_rows_is_twice_the_work(kind: str, tmp_path: Path) -> None:
    """If the rows are doubled and doubled again, the second doubling adds twice the work of the first. A copy
    of all rows before each new row would add four times as much.
    """
    example, done = EXAMPLES[kind], list[Work]()
    for times in SIZES:
        path = tmp_path / f"{times}{Path(example.file).suffix}"
        example.write(path, repeated(example.columns, times))
        if not done:
            stored_here(path)  # loads the library and whatever else is used for the first time
        samples: list[int] = []
        done.append(work_of(partial(read_samples, path, samples)))
        assert samples == [times * N]
    for what, most_more in MOST_MORE.items():
        a, b, c = (getattr(one, what) for one in done)
        assert c - b <= 2.1 * (b - a) + most_more, (
            f"{FORMATS[kind].reader}: work grows faster than the rows: "
            f"{what} for {[times * N for times in SIZES]} rows: {a}, {b}, {c}"
        )


def read_samples(path: Path, samples: list[int]) -> None:
    samples.append(stored_here(path).samples)
