"""A small HTTP server on this machine that can cut connections, refuse, and hand out parts of files."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import StreamRequestHandler, ThreadingTCPServer


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
        What was asked for, HEAD left out.
    heads : list of str
        Paths of which only the headers were asked for.
    ranges : bool
        Whether parts of files are handed out.
    etag, modified : dict of str to str
        Tag and date of files, by path; sent along, and looked at when ``If-Range`` comes.
    if_range : bool
        Whether ``If-Range`` is looked at; a server that does not hands out the range of whatever it has now.
    spans : bool
        Whether ``Content-Range`` is sent.
    lengths : bool
        Whether ``Content-Length`` is sent, which servers that make a file on the fly do not.
    chunked : bool
        Whether files are sent in chunks, as such servers do.
    most : int
        Bytes of a range that are sent at a time; 0 = all.
    """

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self.cut_after, self.cuts = 0, 0
        self.status: dict[str, int] = {}
        self.requests: list[tuple[str, str]] = []
        self.heads: list[str] = []
        self.ranges, self.if_range, self.spans, self.lengths = True, True, True, True
        self.chunked, self.most = False, 0
        self.etag: dict[str, str] = {}
        self.modified: dict[str, str] = {}


@contextmanager
def serving(shelf: Shelf) -> Iterator[str]:
    """Serve a shelf; yields the base address."""

    class Handler(BaseHTTPRequestHandler):
        def do_HEAD(self) -> None:
            shelf.heads.append(self.path)
            if self.path in shelf.status or self.path not in shelf.files:
                self.send_error(shelf.status.get(self.path, 404))
                return
            self.headers_of(200, len(shelf.files[self.path]))

        def do_GET(self) -> None:
            asked = self.headers.get("Range", "")
            shelf.requests.append((self.path, asked))
            if self.path in shelf.status or self.path not in shelf.files:
                self.send_error(shelf.status.get(self.path, 404))
                return
            content = shelf.files[self.path]
            start = int(asked.removeprefix("bytes=").split("-")[0]) if asked and self.ranged() else 0
            if start >= len(content) > 0:
                self.headers_of(416, 0, f"bytes */{len(content)}")
                return
            rest = content[start:][: shelf.most or None] if start else content
            span = f"bytes {start}-{start + len(rest) - 1}/{len(content)}" if start else ""
            self.headers_of(206 if start else 200, len(rest), span)
            if shelf.cuts:
                shelf.cuts -= 1
                rest = rest[: shelf.cut_after]
                self.close_connection = True
            if shelf.chunked:
                end = b"0\r\n\r\n" if rest == content else b""
                rest = b"%x\r\n%s\r\n%s" % (len(rest), rest, end)
            with contextlib.suppress(ConnectionError):  # who asked may have seen enough
                self.wfile.write(rest)

        def ranged(self) -> bool:
            validator = self.headers.get("If-Range", "")
            same = validator in ("", shelf.etag.get(self.path), shelf.modified.get(self.path))
            return shelf.ranges and (same or not shelf.if_range)

        def headers_of(self, code: int, length: int, span: str = "") -> None:
            self.send_response(code)
            if shelf.chunked:
                self.send_header("Transfer-Encoding", "chunked")
            elif shelf.lengths:
                self.send_header("Content-Length", str(length))
            if span and shelf.spans:
                self.send_header("Content-Range", span)
            if self.path in shelf.etag:
                self.send_header("ETag", shelf.etag[self.path])
            if self.path in shelf.modified:
                self.send_header("Last-Modified", shelf.modified[self.path])
            self.end_headers()

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


@contextmanager
def answering(answer: bytes) -> Iterator[str]:
    """Answer whatever is asked with these bytes and close the connection; yields the base address."""

    class Handler(StreamRequestHandler):
        def handle(self) -> None:
            while self.rfile.readline() not in (b"\r\n", b""):
                pass
            self.wfile.write(answer)

    with ThreadingTCPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}/"
        finally:
            server.shutdown()
            thread.join()
