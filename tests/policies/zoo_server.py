"""Upstream's files on a server of this machine, with faults where a test wants them."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Literal

Fault = Literal["half", "hang up", "error"]


class ZooServer(ThreadingHTTPServer):
    """Serves a folder.

    Attributes:
        served: paths asked for, in order.
        faults: what happens to files whose path ends so: half of it comes, nothing, or HTTP 500.
        patience: number of files it answers for before it hangs up on everybody, or ``None``.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self.served: list[str] = []
        self.faults: dict[str, Fault] = {}
        self.patience: int | None = None
        super().__init__(("127.0.0.1", 0), _Handler)

    @property
    def url(self) -> str:
        """Base of upstream's layout, with ``{commit}`` to be filled in."""
        return f"http://127.0.0.1:{self.server_port}/{{commit}}/"


class _Handler(SimpleHTTPRequestHandler):
    server: ZooServer

    def __init__(self, *args: Any):
        super().__init__(*args, directory=str(args[2].folder))

    def log_message(self, format: str, *args: object) -> None:
        pass

    def do_GET(self) -> None:
        server = self.server
        server.served.append(self.path)
        fault = next((fault for end, fault in server.faults.items() if self.path.endswith(end)), None)
        if fault == "hang up" or (server.patience is not None and len(server.served) > server.patience):
            self.close_connection = True
        elif fault == "error":
            self.send_error(500)
        elif fault == "half":
            self._send_half()
        else:
            super().do_GET()

    def _send_half(self) -> None:
        content = Path(self.translate_path(self.path)).read_bytes()
        self.send_response(200)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content[: len(content) // 2])
        self.close_connection = True


@contextmanager
def serving(folder: Path) -> Iterator[ZooServer]:
    """A server that runs in the meantime."""
    with ZooServer(folder) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield server
        server.shutdown()
        thread.join()
