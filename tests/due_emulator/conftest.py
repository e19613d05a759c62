"""Lets these tests import the emulator as `tools.due_emulator`, from wherever pytest is started."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
