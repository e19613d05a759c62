"""Checks of folders that the program writes to."""

import os
from collections.abc import Iterator
from pathlib import Path

from fltea.diagnostics.finding import Finding, ok, problem

SERVICE_USER = "fltea"


def first_existing(folder: Path) -> Path:
    """Return the folder if it exists, else the nearest parent folder that exists."""
    return next((path for path in (folder, *folder.parents) if path.exists()), folder)


def check_writable(check: str, folder: Path) -> Iterator[Finding]:
    """Yield a finding if the folder cannot be written, or is the service's. `check`: name of the check."""
    existing = first_existing(folder)
    if not existing.is_dir():
        yield problem(check, f"{existing} is no folder.", "give another one.")
    elif not os.access(existing, os.W_OK | os.X_OK):
        owner = existing.owner()
        if owner == SERVICE_USER:
            yield ok(check, f"{folder} is the service's, which writes as the user '{owner}'")
        else:
            remedy = f"choose another folder, or: sudo install -d -o $USER {folder}"
            yield problem(check, f"{folder} cannot be written ({existing} belongs to {owner}).", remedy)
