"""A simulated stage behind a TCP socket, which optionally logs every drive: python tcp_server.py PORT [LOG]."""

import sys
import time
from pathlib import Path
from socketserver import StreamRequestHandler, TCPServer

from piezo_model import plants

PLANT = plants.Sensor(plants.get("relay_preisach", sample_time=2e-3), noise_um=0.002)
LOG = Path(sys.argv[2]).open("w", encoding="ascii", buffering=1) if len(sys.argv) > 2 else None  # noqa: SIM115


class Stage(StreamRequestHandler):
    """One connection at a time; the stage keeps its state between them."""

    def handle(self) -> None:
        """Answer each drive with a measurement."""
        for line in self.rfile:
            x = float(line)
            if LOG is not None:
                LOG.write(f"{time.perf_counter()!r} {x!r}\n")
            self.wfile.write(f"{PLANT.step(x)!r}\n".encode("ascii"))


if __name__ == "__main__":
    TCPServer.allow_reuse_address = True
    with TCPServer(("127.0.0.1", int(sys.argv[1])), Stage) as server:
        print(f"port {server.server_address[1]}", flush=True)
        server.serve_forever()
