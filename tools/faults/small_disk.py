"""A small disk that the caller can fill, and whose space the caller can free again."""

import os
import resource
import subprocess
from collections.abc import Sequence
from pathlib import Path

SIZE = "4m"
WHERE_FULL, WHERE_LIMITED = "disk_full", "record_failed"
"""Kinds of errors: the first is what a program has to report if its file system is full, the second if the
size of its files is limited.
"""


class SmallDisk:
    """A small file system that only one program sees.

    If the system does not permit such a file system, a limit on the size of the program's files replaces it.

    `folder`: folder into which the program records. `size`: size in the syntax of `mount`. `is_mounted`:
    whether there is a file system, not only a limit. `kind`: kind of the error that the program has to report
    when the disk is full. `before`: words to put before the program's command line, so that the program sees
    the file system.
    """

    def __init__(self, folder: Path, size: str = SIZE) -> None:
        folder.mkdir()
        self.folder = folder
        mount = f"mount -t tmpfs -o size={size} tmpfs '{folder}' && exec \"$@\""
        before = ("unshare", "--map-root-user", "--mount", "sh", "-c", mount, "sh")
        self.is_mounted = _works(before)
        self.before = before if self.is_mounted else ()
        self.kind = WHERE_FULL if self.is_mounted else WHERE_LIMITED
        self._pid = self._fd = -1
        self._keeper: subprocess.Popen[bytes] | None = None

    def attach(self, pid: int) -> None:
        """Open the small disk of the program with the process number `pid`, so that `fill` can reach it.

        Only that program sees the disk. It stays open here until `close` is called.
        """
        self._pid = pid
        self._fd = os.open(f"/proc/{self._pid}/root{self.folder}", os.O_RDONLY | os.O_DIRECTORY)

    def hold(self) -> Sequence[str]:
        """Mount the disk until `close` is called.

        Only programs in the namespace of the mount see the disk. Return the beginning of a command (`nsenter
        …`) that runs a program there.
        """
        keep = ("sh", "-c", "echo; exec sleep infinity")
        self._keeper = subprocess.Popen([*self.before, *keep], stdout=subprocess.PIPE)
        assert self._keeper.stdout is not None
        self._keeper.stdout.readline()  # This read waits until the disk is mounted.
        self.attach(self._keeper.pid)
        return "nsenter", "-t", str(self._pid), "--user", "--mount", "--preserve-credentials"

    @property
    def inside(self) -> Path:
        """Path of the disk for the caller, who does not see it under the path that the program uses.

        The path stays valid after the program has ended.
        """
        return Path(f"/proc/self/fd/{self._fd}")

    def fill(self) -> None:
        """Fill the disk completely, or limit the size of the program's files to a byte."""
        if not self.is_mounted:
            resource.prlimit(self._pid, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))
            return
        try:
            with (self.inside / "ballast").open("wb", buffering=0) as ballast:
                while True:
                    ballast.write(bytes(4096))
        except OSError:
            pass  # the disk is full

    def free(self) -> None:
        """Delete what filled the disk, or remove the limit."""
        if self.is_mounted:
            (self.inside / "ballast").unlink()
        else:
            no_limit = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
            resource.prlimit(self._pid, resource.RLIMIT_FSIZE, no_limit)

    def close(self) -> None:
        """Close the disk, and end the process that kept it mounted."""
        if self._fd >= 0:
            os.close(self._fd)
        if self._keeper is not None:
            self._keeper.kill()
            self._keeper.communicate()


def _works(before: Sequence[str]) -> bool:
    try:
        return subprocess.run([*before, "true"], capture_output=True).returncode == 0
    except OSError:
        return False
