"""Tests that each source is what its row in `SOURCES` says, and keeps what `Source` promises.

What a row cannot say stands in `CONTRACTS` of `tests/rig/source_contracts.py`.
"""

import ast
import importlib
import inspect

import pytest
from fltea.records.errors import UsageError, of_input
from fltea.records.events import Trouble
from fltea.records.kinds import ERROR_KINDS
from fltea.records.ports import Source
from fltea.service.ingest.receivers import receiver_of
from fltea.settings.config import load_config
from fltea.settings.sources import BY_SCHEME, SOURCES, SourceKind
from fltea.sources.open_source import open_source

from tests.rig.hostile_words import URLS
from tests.rig.source_contracts import contract_of

WIRE = {"fltea.sources.wire_events", "fltea.sources.mcap", "fltea._native"}
"""Modules by which a source gives what a board has estimated itself."""

SINGLE = [kind for kind in SOURCES if not kind.shared]
EACH = pytest.mark.parametrize("kind", SINGLE, ids=lambda kind: kind.schemes[0])


def opened(url: str, **settings: object) -> Source:
    return open_source(load_config(None, {"source": url, **settings}))


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
    source = opened(url)
    events = source.events()
    trouble = next(event for event in events if isinstance(event, Trouble))
    assert trouble.fatal, f"{kind.module}: {trouble.kind} has to be fatal, since {url} does not exist"
    assert trouble.kind in ERROR_KINDS
    source.close()
    assert not [event for event in events if not isinstance(event, Trouble)]


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
