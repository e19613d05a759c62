"""A connection to a server that a caller can cut. Both ends then stay open, and no data passes."""

import contextlib
import socket
import threading

CHUNK = 1 << 16


class CutLine:
    """A TCP port of this machine that forwards connections to another port.

    While the connection is cut, neither end notices it. Data that one end sends wait in this object, like
    packets that are sent again and again. If one end closes the connection, the other end does not learn it
    before the data pass again. A new connection gets no answer.

    `port`: the port that clients connect to. `to`: the port to which their data are forwarded.
    """

    def __init__(self, to: int) -> None:
        self._to = to
        self._whole = threading.Event()
        self._whole.set()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        self._sockets = [self._listener]
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Cut the connections, so that no data pass."""
        self._whole.clear()

    def heal(self) -> None:
        """Pass on the waiting data, and forward all later data."""
        self._whole.set()

    def close(self) -> None:
        """Close the port and all connections."""
        self._whole.set()
        for one in self._sockets:
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):  # `accept` fails when `close` has closed the port.
            while True:
                near, _ = self._listener.accept()
                threading.Thread(target=self._connect, args=(near,), daemon=True).start()

    def _connect(self, near: socket.socket) -> None:
        self._sockets.append(near)
        self._whole.wait()
        try:
            far = socket.create_connection(("127.0.0.1", self._to))
        except OSError:  # The server is not running.
            near.close()
            return
        self._sockets.append(far)
        for ends in ((near, far), (far, near)):
            threading.Thread(target=self._pass_on, args=ends, daemon=True).start()

    def _pass_on(self, from_: socket.socket, to: socket.socket) -> None:
        # A call fails if the thread of the other direction has already ended the connection.
        with contextlib.suppress(OSError):
            while data := from_.recv(CHUNK):
                self._whole.wait()
                to.sendall(data)
        self._whole.wait()
        for one in (from_, to):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
