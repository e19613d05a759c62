"""Lets these tests make recordings as those of the host do."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "tests/host"), str(ROOT / "tests/protocol"), str(ROOT / "tools")]
