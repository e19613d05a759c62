"""What all tests share: hypothesis without randomness, and the folder of recordings of real sensors, if it is
present.

No test runs with a native module that was built from other sources. Python and such a module may number the
kinds of parts of a noise in different ways, so that one number would mean two different kinds.
"""

import gc
import os
import runpy
import signal
import sys
import time
from collections.abc import Generator
from pathlib import Path

import pytest
from fltea import _native
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

from tests.rig.tiers import LATER_TIERS, names_a_tier

ROOT = Path(__file__).resolve().parents[1]
RECORDINGS = ROOT.parent / "shared/recordings"


BEGAN_S = time.monotonic()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option by which `make near` ends in time."""
    parser.addoption("--no-test-after", type=float, metavar="SECONDS", help="skip tests that begin later")


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test that would begin later than `--no-test-after` permits."""
    limit_s = item.config.option.no_test_after
    if limit_s is not None and time.monotonic() - BEGAN_S > limit_s:
        pytest.skip(f"more than {limit_s:g} s have passed; `make test` runs this test")


def pytest_configure() -> None:
    """Refuse a native module built from other sources.

    The next set-up then rebuilds the module, even if the module's file is newer than its sources.
    """
    wanted = runpy.run_path(str(ROOT / "host/native/source_hash.py"))["source_hash"]()
    if getattr(_native, "SOURCE_HASH", "") != wanted and not os.environ.get("FLTEA_STALE_NATIVE"):
        (Path(sys.prefix) / ".dev").unlink(missing_ok=True)
        raise pytest.UsageError(
            "the native module was built from other sources: run `make setup`. While the C++ is being "
            "changed, FLTEA_STALE_NATIVE=1 runs tests of what does not depend on it."
        )


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep the garbage collector away from modules and tests.

    They are about a million objects, which stay until the end. Otherwise the collector would visit them
    again and again, while they are made and whenever it visits all objects.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files that have no test of the second or third tier when only that tier is wanted.

    Most files have no such test, and each of the two workers would import them all.
    """
    tier = LATER_TIERS.get(config.option.markexpr)
    is_test = collection_path.name.startswith("test_") and collection_path.suffix == ".py"
    return True if tier is not None and is_test and not names_a_tier(collection_path, tier) else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Refuse a test whose mark of a later tier (such as `slow`) is not written in its own file, since
    `pytest_ignore_collect` would leave out this file.

    A test with the mark `long` gets the mark `slow`, too.
    """
    for item in items:
        for tier in LATER_TIERS.values():
            if item.get_closest_marker(tier) and not names_a_tier(item.path, tier):
                raise pytest.UsageError(
                    f"{item.path} gets the mark `{tier}` from elsewhere: name it in this file"
                )
        if item.get_closest_marker("long"):
            item.add_marker("slow")


# A shell starts background jobs with SIGINT ignored, and `nohup` ignores SIGHUP: programs that tests start
# would inherit that, so it is undone here.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# In every run, hypothesis tries the same 25 examples for each test. A test that needs more examples to reach
# its cases sets a larger number. There is no deadline, so no test fails because the machine is slow or busy.
# For more and other examples, as before a release: make test ARGS=--hypothesis-profile=thorough
# Hypothesis 6.170 also takes constants from the source of each module of this project that is loaded. With
# these constants, a test's examples would depend on the tests before it, so they are left out here.
providers._get_local_constants = lambda: providers._local_constants
ANY_PACE = {"database": None, "deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("fixed", derandomize=True, max_examples=25, **ANY_PACE)
settings.register_profile("thorough", max_examples=1000, print_blob=True, **ANY_PACE)
settings.load_profile("fixed")


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Return the folder of the recordings of real sensors, which are not part of the project."""
    if not RECORDINGS.is_dir():
        pytest.skip(f"no real recordings: {RECORDINGS} does not exist")
    return RECORDINGS
