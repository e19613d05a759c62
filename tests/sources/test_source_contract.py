"""Tests that each source is what its row in `SOURCES` says, and keeps what `Source` promises.

What a row cannot say stands in `CONTRACTS` of `tests/rig/source_contracts.py`.
"""

import ast
import contextlib
import gc
import importlib
import inspect
import os
import queue
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from fltea.records.errors import UsageError, of_input
from fltea.records.events import Event, RawBlock, Tick, Trouble
from fltea.records.kinds import ERROR_KINDS
from fltea.records.ports import Source
from fltea.records.records import Hello
from fltea.service.ingest.receivers import receiver_of
from fltea.settings.config import load_config
from fltea.settings.sources import BY_SCHEME, SOURCES, SourceKind
from fltea.sources.open_source import open_source
from fltea.sources.opening import Named

from tests.rig.blocks import of
from tests.rig.hostile_words import URLS
from tests.rig.source_contracts import TIMED, Quiet, contract_of

WIRE = {"fltea.sources.wire_events", "fltea.sources.mcap", "fltea._native"}
"""Modules by which a source gives what a board has estimated itself."""

HANGS_S = 30.0
"""A source that is silent for this time hangs [s]."""
MOST_EVENTS = 1000
"""An event that is due comes after fewer others than this."""

SINGLE = [kind for kind in SOURCES if not kind.shared]
EACH = pytest.mark.parametrize("kind", SINGLE, ids=lambda kind: kind.schemes[0])


def opened(url: str, **settings: object) -> Source:
    return open_source(load_config(None, {"source": url, **settings}))


class Iteration:
    """Iterates over the events of a source in a thread, so that a source that hangs fails its test.

    `found`: the events that `until` and `end` have taken.
    """

    def __init__(self, source: Source, name: str) -> None:
        self._source, self._name = source, name
        self.found: list[Event] = []
        self._queue: queue.SimpleQueue[Event | Exception] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=f"events of {name}", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            for event in self._source.events():
                self._queue.put(event)
        except Exception as error:
            self._queue.put(error)

    def _take(self, timeout_s: float) -> Event:
        event = self._queue.get(timeout=timeout_s)
        if isinstance(event, Exception):
            raise event
        self.found.append(event)
        return event

    def until(self, kind: type[Event] | None) -> None:
        """Take events up to the first one of this kind, or up to the first of all."""
        what = "no event" if kind is None else f"no {kind.__name__}"
        for _ in range(MOST_EVENTS):
            try:
                event = self._take(HANGS_S)
            except queue.Empty:
                break
            if kind is None or isinstance(event, kind):
                return
        pytest.fail(f"{self._name}: its events give {what}; found: {self.found[:10]}")

    def end(self) -> None:
        """Close the source, and take the events that come after that."""
        self._source.close()
        self._thread.join(HANGS_S)
        assert not self._thread.is_alive(), f"{self._name}: `close` does not end an iteration that waits"
        while not self._queue.empty():
            self._take(0)


@EACH
def test_each_is_live_and_prompt_as_expected(kind: SourceKind, tmp_path: object) -> None:
    expected = contract_of(kind)
    place = expected.missing if expected.live else ""
    if kind.schemes[0] == "replay":
        place = f"{tmp_path}/rest.csv"
        with open(place, "w", encoding="utf-8") as file:
            file.write("gyro_x_dps\n" + "1\n2\n" * 100)
    how = {"replay.rate_hz": 100.0} if kind.described else {}
    source = opened(f"{kind.schemes[0]}:{place}", **{"estimator.startup": 20}, **how)
    try:
        found = source.live, source.prompt
        assert found == (expected.live, expected.prompt), f"{kind.module}: live, prompt = {found}"
        assert isinstance(source.unix_offset_ns, int)
        assert source.link_stats().bytes == 0
    finally:
        source.close()
        source.close()


@EACH
def test_what_is_missing_is_waited_for_by_a_live_source_and_refused_by_another(kind: SourceKind) -> None:
    """The trouble of a live source is fatal, so that `--once` ends."""
    expected, scheme = contract_of(kind), kind.schemes[0]
    if not expected.missing:
        return
    url = f"{scheme}:{expected.missing}"
    if not expected.live:
        with pytest.raises(UsageError, match="none"):
            opened(url)
        return
    iteration = Iteration(opened(url), kind.module)
    iteration.until(Trouble)
    iteration.end()
    trouble, *_ = of(Trouble, iteration.found)
    assert trouble.fatal, f"{kind.module}: {trouble.kind} has to be fatal, since {url} does not exist"
    assert trouble.kind in ERROR_KINDS
    assert not of(Hello, iteration.found) + of(RawBlock, iteration.found)


def places(kind: SourceKind, folder: Path, opened: ExitStack) -> Iterator[Quiet]:
    """Yield places at which a source of this kind waits."""
    contract = contract_of(kind)
    if contract.quiet is not None:
        yield opened.enter_context(contract.quiet(folder))
    if contract.live:
        yield Quiet(contract.missing, {}, lambda data: None)


@EACH
def test_each_ticks_while_nothing_comes_and_close_ends_its_waiting(kind: SourceKind, tmp_path: Path) -> None:
    contract = contract_of(kind)
    with ExitStack() as stack:
        for place, settings, _ in places(kind, tmp_path, stack):
            source = opened(f"{kind.schemes[0]}:{place}", **settings)
            iteration = Iteration(source, f"{kind.module}, {kind.schemes[0]}:{place}")
            iteration.until(Tick if contract.ticks else None)
            iteration.end()
            source.close()


@EACH
def test_samples_that_wait_for_their_rate_come_after_close(kind: SourceKind, tmp_path: Path) -> None:
    contract = contract_of(kind)
    if contract.quiet is None or not contract.timed:
        assert not (kind.described and contract.ticks), (
            f"tests/rig/source_contracts.py: {kind.schemes[0]} takes a column of times, so it needs `timed`"
        )
        return
    with contract.quiet(tmp_path) as (place, settings, send):
        source = opened(f"{kind.schemes[0]}:{place}", **settings)
        iteration = Iteration(source, kind.module)
        iteration.until(Tick)  # the place is open
        send(contract.timed)
        while source.link_stats().bytes < len(contract.timed):
            iteration.until(Tick)
        early = of(RawBlock, iteration.found)
        iteration.end()
    assert not early, f"{kind.module}: the samples did not wait for their rate"
    found = sum(len(block.sequence) for block in of(RawBlock, iteration.found))
    assert found == TIMED, f"{kind.module}: {found} of {TIMED} samples came after `close`"


@EACH
@pytest.mark.parametrize(
    "iterates",
    [pytest.param(True, id="iterated", marks=pytest.mark.slow), pytest.param(False, id="only closed")],
)
def test_each_leaves_no_descriptor_open(kind: SourceKind, iterates: bool, tmp_path: Path) -> None:
    with ExitStack() as stack:
        for place, settings, _ in places(kind, tmp_path, stack):
            url = f"{kind.schemes[0]}:{place}"
            for _ in range(2):  # what the first time leaves open may be kept for all sources
                before = descriptors()
                use_once(opened(url, **settings), url, iterates=iterates)
                gc.collect()
                left = {number: name for number, name in descriptors().items() if before.get(number) != name}
            assert not left, f"{kind.module}: {url} leaves open {left}"


def use_once(source: Source, name: str, *, iterates: bool) -> None:
    if iterates:
        iteration = Iteration(source, name)
        iteration.until(None)
        iteration.end()
    source.close()


def descriptors() -> dict[int, str]:
    """Return the open file descriptors of this process, and what each stands for."""
    found = {}
    for number in os.listdir("/proc/self/fd"):
        with contextlib.suppress(FileNotFoundError):  # the descriptor of the list itself
            found[int(number)] = os.readlink(f"/proc/self/fd/{number}")
    return found


@EACH
def test_what_one_source_alone_can_read_from_has_two_names(kind: SourceKind) -> None:
    """The pairs of names are tried in `tests/machine/test_doctor.py`."""
    contract, scheme = contract_of(kind), kind.schemes[0]
    alone = importlib.import_module(kind.module).only_reader_of(Named(scheme, contract.missing))
    assert bool(alone) == bool(contract.same), f"{kind.module}: only_reader_of gives '{alone}'"
    assert alone or not contract.live, f"{kind.module}: only one source can read from a device"


@EACH
def test_only_a_source_of_frames_gives_the_estimates_of_a_board(kind: SourceKind) -> None:
    tree = ast.parse(inspect.getsource(importlib.import_module(kind.module)))
    imported = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert kind.samples_only == (not imported & WIRE), (
        f"settings/sources.py: samples_only of {kind.schemes[0]} is {kind.samples_only}, and {kind.module} "
        f"imports {imported & WIRE or 'nothing that decodes frames'}"
    )


@EACH
def test_only_what_takes_the_options_of_columns_is_described(kind: SourceKind) -> None:
    opens = inspect.getsource(importlib.import_module(kind.module).open_named)
    assert kind.described == ("replay.how" in opens), (
        f"settings/sources.py: described of {kind.schemes[0]} is {kind.described}, and open_named of "
        f"{kind.module} {'uses' if 'replay.how' in opens else 'does not use'} the options of columns"
    )


@pytest.mark.parametrize("scheme", BY_SCHEME)
def test_a_bad_url_is_an_error_of_usage(scheme: str) -> None:
    """A URL that can be opened may still lead to nothing, which is a trouble of the source."""
    kind = BY_SCHEME[scheme]
    refused = 0
    for url in [f"{scheme}:ftp://x?no_such_key=1", *(url for url in URLS if url.startswith(f"{scheme}:"))]:
        try:
            config = load_config(None, {"source": url})
            if kind.shared:
                receiver_of(config)
            else:
                open_source(config).close()
        except UsageError:
            refused += 1
        except OSError as error:  # a name that no file can have
            if not isinstance(of_input(error), UsageError):
                raise
            refused += 1
        else:
            assert "no_such_key" not in url, f"{kind.module} accepts {url}"
    assert refused
