"""Which group may use a device, and what opens it to a user who may not."""

import grp
import os
import stat
from pathlib import Path
from typing import NamedTuple


class Group(NamedTuple):
    """The group of a file; joinable: its members may read and write, and it is not root's."""

    gid: int
    name: str
    joinable: bool


def group_of(path: str | Path) -> Group | None:
    """Return the group of a file; None if there is no such file."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    both = stat.S_IRGRP | stat.S_IWGRP
    try:
        name = grp.getgrgid(status.st_gid).gr_name
    except KeyError:
        name = str(status.st_gid)
    return Group(status.st_gid, name, status.st_mode & both == both and status.st_gid != 0)


def join_remedy(path: str, usual: str, rule: str) -> str:
    """Return what opens a device to its user: to join its group, or to give it to the `usual` one.

    rule: of udev, which gives it to that group.
    """
    group = group_of(path)
    if group is None:
        return f"Such devices usually belong to the group '{usual}': sudo usermod -aG {usual} $USER."
    if group.joinable:
        return (
            f"It belongs to the group '{group.name}': join it with 'sudo usermod -aG {group.name} $USER', "
            "then log out and in again."
        )
    return (
        f"It admits no group that you could join (its group is '{group.name}'): let a udev rule give it to "
        f"the group '{usual}' ({rule}), and join that group."
    )
