"""A port that tests plug in and pull out."""

import contextlib
import os
import pty
import tty
from pathlib import Path


class Terminal:
    """A pseudo-terminal that can go and come back.

    link: its name, since the system gives a freed /dev/pts/N to the next who asks. master: the other side.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self.plug()

    def plug(self) -> None:
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(self.master, False)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(slave))
        os.close(slave)

    def unplug(self) -> None:
        self.link.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # it may be unplugged already
            os.close(self.master)

    def send(self, data: bytes) -> None:
        assert os.write(self.master, data) == len(data)
