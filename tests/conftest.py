"""What all tests share: hypothesis without chance, and the real recordings where they are at hand."""

import sys
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).resolve().parents[1]
RECORDINGS = ROOT.parent / "shared/recordings"

# Every test may use the stand-ins of tests/rig, `tools` as a package, and the generators within it.
sys.path[:0] = [str(ROOT), str(ROOT / "tests/rig"), str(ROOT / "tools")]

# Every run tries the same examples; a slow machine fails nothing.
settings.register_profile("fixed", derandomize=True, database=None, deadline=None)
settings.load_profile("fixed")


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Folder of the recordings of real sensors, which are not part of the project."""
    if not RECORDINGS.is_dir():
        pytest.skip(f"no real recordings: {RECORDINGS} does not exist")
    return RECORDINGS
