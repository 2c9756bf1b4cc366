"""A stage behind a TCP socket: one line of text with the drive goes out, one with the measurement comes back.

python examples/live/tcp_server.py 7654 &
piezobench live --device examples/live/tcp_stage.py --sine 2Hz:10um --rate 500
"""

import os
import socket


class TcpStage:
    """The client; the environment variable TCP_STAGE has the address of the server, host:port."""

    input_unit, output_unit = "V", "um"
    x_limits, y_range = (0.0, 150.0), (-20.0, 20.0)
    rate_limit, rest = 3_000.0, 0.0
    timeout_s = 0.5

    def open(self) -> None:
        """Connect."""
        host, _, port = os.environ.get("TCP_STAGE", "127.0.0.1:7654").partition(":")
        self._socket = socket.create_connection((host, int(port)), timeout=5.0)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._lines = self._socket.makefile("r", encoding="ascii")

    def exchange(self, x: float) -> float:
        """Write the drive and return the measured output."""
        self._socket.sendall(f"{x!r}\n".encode("ascii"))
        return float(self._lines.readline())

    def close(self) -> None:
        """Disconnect."""
        self._socket.close()
