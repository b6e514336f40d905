"""A small HTTP server on this machine that can cut connections, refuse, and hand out parts of files."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class Shelf:
    """Files by path, and the ways in which serving them goes wrong.

    Attributes
    ----------
    files : dict of str to bytes
        Content by path (with leading slash).
    cut_after : int
        Bytes after which a connection is cut; 0 = never.
    cuts : int
        How many answers are still to be cut.
    status : dict of str to int
        Status to answer with instead of the file.
    requests : list of (path, range)
        What was asked for.
    ranges : bool
        Whether parts of files are handed out.
    """

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self.cut_after, self.cuts = 0, 0
        self.status: dict[str, int] = {}
        self.requests: list[tuple[str, str]] = []
        self.ranges = True


@contextmanager
def serving(shelf: Shelf) -> Iterator[str]:
    """Serve a shelf; yields the base address."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked = self.headers.get("Range", "")
            shelf.requests.append((self.path, asked))
            if self.path in shelf.status or self.path not in shelf.files:
                self.send_error(shelf.status.get(self.path, 404))
                return
            content = shelf.files[self.path]
            start = int(asked.removeprefix("bytes=").split("-")[0]) if asked and shelf.ranges else 0
            if start >= len(content) > 0:
                self.send_error(416)
                return
            rest = content[start:]
            self.send_response(206 if start else 200)
            self.send_header("Content-Length", str(len(rest)))
            self.end_headers()
            if shelf.cuts:
                shelf.cuts -= 1
                rest = rest[: shelf.cut_after]
                self.close_connection = True
            self.wfile.write(rest)

        def log_message(self, format: str, *args: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
