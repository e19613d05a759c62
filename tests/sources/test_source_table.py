"""Tests that the table of sources is complete.

If a new source lacks an entry, a test's failure says which one, and in which file the entry belongs.
"""

import importlib
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from fltea.cli.setting_flags import Sources
from fltea.machine.doctor.checks_sources import check_source
from fltea.records.errors import UsageError
from fltea.service.ingest.receiver import ReceiverModule
from fltea.service.ingest.receivers import receiver_of
from fltea.settings.config import load_config
from fltea.settings.outputs import OUTPUTS
from fltea.settings.sources import BY_SCHEME, SOURCES, SourceKind, is_shared, kind_of
from fltea.sources.opening import SourceModule

from tests.rig.fake_system import FakeSystem
from tests.rig.host_support import ROOT
from tests.rig.signatures import lacking

EACH = pytest.mark.parametrize("kind", SOURCES, ids=lambda kind: kind.schemes[0])
SHARED = [kind for kind in SOURCES if kind.shared]


def test_no_scheme_stands_for_two_kinds() -> None:
    assert len(BY_SCHEME) == sum(len(kind.schemes) for kind in SOURCES)


@EACH
def test_the_scheme_of_its_example_is_its_own(kind: SourceKind) -> None:
    assert kind_of(kind.example) is kind
    assert is_shared(kind.example) is kind.shared


@EACH
def test_the_module_of_each_opens_it_and_checks_it(kind: SourceKind) -> None:
    declared = ReceiverModule if kind.shared else SourceModule
    opens = ["receiver_of"] if kind.shared else ["open_named", "only_reader_of"]
    found = lacking(importlib.import_module(kind.module), declared, *opens)
    found += lacking(importlib.import_module(kind.check or kind.module), declared, "check_source")
    assert not found, f"{found} (see the row of {kind.schemes[0]}: in settings/sources.py)"


def test_the_daemon_loads_no_library_and_no_check_before_it_needs_them() -> None:
    done = subprocess.run(
        [sys.executable, "-c", "import sys, fltea.service.daemon; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    rows = [*SOURCES, *OUTPUTS]
    late = {row.library for row in rows} | {kind.check for kind in SOURCES} | {"subprocess", "smbus2"}
    assert not late & set(done.stdout.split())


@pytest.mark.parametrize("scheme", [scheme for kind in SHARED for scheme in kind.schemes])
def test_each_shared_source_has_a_receiver(scheme: str) -> None:
    assert callable(receiver_of(load_config(None, {"source": f"{scheme}://server.example"})))
    with pytest.raises(UsageError):
        receiver_of(load_config(None, {"source": f"{scheme}:server.example"}))


@EACH
def test_the_help_and_the_guide_name_each(kind: SourceKind) -> None:
    (option,) = (one for one in Sources.__metadata__ if hasattr(one, "help"))
    assert f"`{kind.example}`" in option.help
    page = (ROOT / "host/docs/guide/sources.md").read_text(encoding="utf-8")
    cells = re.findall(r"^\| (`[^|]+) \|", page, re.MULTILINE)
    for scheme in kind.schemes:
        assert any(f"`{scheme}:" in cell for cell in cells), f"guide/sources.md: no row has `{scheme}:…`"


def test_kinds_that_share_a_phrase_of_the_help_are_alike() -> None:
    """Kinds with an empty `what` get the phrase of the next row, which may be that of something else."""
    first = SOURCES[0]
    for before, kind in pairwise(SOURCES):
        first = kind if before.what else first
        for name in ("shared", "described", "samples_only"):
            assert getattr(kind, name) == getattr(first, name), (
                f"settings/sources.py: {kind.schemes[0]} shares the phrase '{kind.what or '…'}' with "
                f"{first.schemes[0]}, whose {name} is another. Give the row above it a phrase (`what`)."
            )
    assert SOURCES[-1].what, "settings/sources.py: no row follows whose phrase describes the last kind, too"


def words_of(kind: SourceKind) -> set[str]:
    return {*kind.schemes, *"_".join(kind.module.split(".")[2:]).split("_")}


@EACH
def test_the_list_of_rooms_names_each(kind: SourceKind) -> None:
    """A word that stands for another kind, too, such as "text", names none of them."""
    readme = (ROOT / "host/README.md").read_text(encoding="utf-8")
    room = kind.module.split(".")[1]
    (row,) = re.findall(rf"^\| `{room}/` \|.*", readme, re.MULTILINE)
    own = words_of(kind).difference(*(words_of(other) for other in SOURCES if other is not kind))
    assert own & set(re.findall(r"[\w-]+", row.lower().replace("²", "2"))), (
        f"host/README.md, the rooms: the row of {room}/ names none of {own}"
    )


@pytest.fixture
def listening() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


@pytest.mark.parametrize("scheme", ["mqtt", "mqtts", "nats"])
def test_the_doctor_says_whether_the_server_of_a_shared_source_answers(
    scheme: str, listening: int, tmp_path: Path
) -> None:
    config = load_config(None, {"source": f"{scheme}://127.0.0.1:{listening}"})
    system = FakeSystem(tmp_path)
    (found,) = check_source(config, system, 0.0)
    assert (found.check, found.level) == ("source", "ok")
    assert f"127.0.0.1, port {listening}" in found.message
    with socket.create_server(("127.0.0.1", 0)) as server:
        closed = server.getsockname()[1]
    config = load_config(None, {"source": f"{scheme}://127.0.0.1:{closed}"})
    (found,) = check_source(config, system, 0.0)
    assert found.level == "problem"
    assert f"port {closed}, cannot be reached" in found.message


def test_the_doctor_says_that_no_machine_can_have_the_host_of_a_shared_source(tmp_path: Path) -> None:
    """Python raises a `UnicodeError` for a part of a name that is too long."""
    config = load_config(None, {"source": f"nats://{'x' * 100}:5555"})
    (found,) = check_source(config, FakeSystem(tmp_path), 0.0)
    assert (found.level, "no machine can have this name" in found.message) == ("problem", True)


def test_the_doctor_looks_at_every_server_of_nats(listening: int, tmp_path: Path) -> None:
    url = f"nats://127.0.0.1:{listening},nats://localhost:{listening}"
    found = list(check_source(load_config(None, {"source": url}), FakeSystem(tmp_path), 0.0))
    assert [one.level for one in found] == ["ok", "ok"]


@pytest.mark.parametrize("kind", SHARED, ids=lambda kind: kind.schemes[0])
def test_the_doctor_says_which_package_a_shared_source_lacks(kind: SourceKind, tmp_path: Path) -> None:
    system = FakeSystem(tmp_path)
    system.without = {kind.library}
    (found,) = check_source(load_config(None, {"source": f"{kind.schemes[0]}://host.example"}), system, 0.0)
    assert found.level == "problem"
    assert f"[{kind.extra}]" in (found.remedy or "")


def test_the_doctor_takes_a_bare_folder_for_a_recording(tmp_path: Path) -> None:
    (found,) = check_source(load_config(None, {"source": str(tmp_path)}), FakeSystem(tmp_path), 0.0)
    assert (found.check, found.level) == ("source", "problem")
    assert f"{tmp_path}: no .mcap file in this folder" in found.message
