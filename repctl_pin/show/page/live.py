"""A page in the browser, served from this process to this machine only.

The server is a thread of this process on 127.0.0.1: however the process ends, nothing is left of it, no
other process and no open port.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
import webbrowser
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any

from ...errors import InputError

HOST = "127.0.0.1"


class LivePage:
    """Serves one page while it is entered: ``with LivePage(page) as live: print(live.url); live.wait()``.

    Entered in the main thread, it is left at Ctrl-C, SIGTERM or the end of the terminal, wherever the block
    is by then; the program goes on behind the block.

    Parameters
    ----------
    page
        The page's HTML.
    port
        Where to listen; 0 takes a free one.

    Raises
    ------
    InputError
        If the port is taken or not allowed.
    """

    def __init__(self, page: str, *, port: int = 0) -> None:
        body = page.encode("utf-8")

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                # another site's name may be made to point here: only our own is answered
                if (self.headers.get("Host") or "").rpartition(":")[0] not in (HOST, "localhost"):
                    self.send_error(403)
                elif self.path.partition("?")[0] != "/":
                    self.send_error(404)
                else:
                    self.send_response(200)
                    self.send_header("Content-Type", "text/html; charset=utf-8")
                    self.send_header("Content-Length", str(len(body)))
                    self.send_header("Cache-Control", "no-store")
                    self.end_headers()
                    self.wfile.write(body)

            def log_message(self, *args: Any) -> None:
                """Say nothing."""

        try:
            self._server = _Server((HOST, port), Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or "no such port"
            raise InputError(f"cannot listen on port {port}: {reason}; choose another --port, or none") from None
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self._server.server_port}/"

    def __enter__(self) -> LivePage:
        self._thread.start()
        self._left, self._before = False, {}
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._stop) for number in _stopping()}
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> bool:
        self._left = True
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
        for number, handler in self._before.items():
            signal.signal(number, handler)
        return isinstance(error, _Stopped)

    def _stop(self, *_: Any) -> None:
        if not self._left:  # a second Ctrl-C does not cut the closing short
            self._left = True
            raise _Stopped

    def open(self) -> bool:
        """Open the browser, where there is a screen; False where there is none."""
        screen = sys.platform in ("darwin", "win32") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        return bool(screen) and webbrowser.open(self.url)

    def wait(self) -> None:
        """Serve until Ctrl-C, SIGTERM or the end of the terminal leave the block."""
        while True:
            time.sleep(1)


class _Stopped(BaseException):
    """A signal asked the server to stop."""


def _stopping() -> list[int]:
    """The signals that stop the server."""
    numbers = [signal.SIGINT, signal.SIGTERM]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # ignored under nohup
        numbers.append(signal.SIGHUP)
    return [int(number) for number in numbers]


class _Server(ThreadingHTTPServer):
    daemon_threads = True  # a browser that reads slowly does not keep us
    block_on_close = False

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a browser that went away."""
