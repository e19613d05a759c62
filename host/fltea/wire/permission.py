"""Finds the group of users that may use a device file, and the command that adds a user to the group."""

import grp
import os
import pwd
import stat
from pathlib import Path
from typing import NamedTuple


class Group(NamedTuple):
    """The group of users to which a file belongs.

    `joinable`: whether a user can gain access by joining the group. This is so if the members of the group
    may read and write the file, and if it is not root's group.
    """

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


class User(NamedTuple):
    """The user who runs this program.

    `in_force`: IDs of the groups to which this process belongs now.
    `granted`: IDs of the groups to which the user belongs after the next login.
    """

    name: str
    in_force: set[int]
    granted: set[int]


def this_user() -> User:
    """Return the user who runs this program."""
    number, in_force = os.geteuid(), {os.getegid(), *os.getgroups()}
    try:
        entry = pwd.getpwuid(number)
        return User(entry.pw_name, in_force, set(os.getgrouplist(entry.pw_name, entry.pw_gid)))
    except (KeyError, OSError):
        return User(str(number), in_force, set())


RULES = {
    "dialout": "sudo make install-udev, in a clone of fltea; then plug the board in again",
    "i2c": 'KERNEL=="i2c-[0-9]*", GROUP="i2c", MODE="0660"',
}
"""Device files usually belong to the group "dialout" (serial ports) or "i2c" (I²C buses). If one does not,
this is the remedy: a udev rule that gives it to that group, or the command that installs such a rule.
"""


def join_remedy(device: str, group: Group | None, user: User) -> str:
    """Return a text that tells the user how to get permission to use a device file.

    `group`: the group of the device; None if the group is not known.
    """
    usual = "i2c" if "i2c" in device else "dialout"
    if group is None:
        return f"Such devices usually belong to the group '{usual}': sudo usermod -aG {usual} {user.name}."
    if not group.joinable:
        return (
            f"{user.name} cannot get access to {device} by joining a group (its group is '{group.name}'). A "
            f"udev rule gives the device to the group '{usual}': {RULES[usual]}."
        )
    if group.gid in user.in_force:
        return (
            f"{user.name} is in the device's group '{group.name}', so a container or a security module "
            "prevents the access."
        )
    if group.gid in user.granted:
        return (
            f"{user.name} has joined the group '{group.name}' only after this login: log out and in again "
            f"(or, for one shell: newgrp {group.name})."
        )
    return f"sudo usermod -aG {group.name} {user.name}, then log out and in again."
