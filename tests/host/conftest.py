"""Lets these tests read the vectors of the protocol with the reader that its own tests use."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "tests/protocol"), str(ROOT / "tools")]
