"""Shows a replay in the browser, from a server that lasts as long as the program runs, or in a notebook."""

from __future__ import annotations

import html
import sys
import threading
import webbrowser
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING

from ...errors import InputError
from .replay import page_of

if TYPE_CHECKING:
    from .motion import PlayableRun


class ReplayServer:
    """Serves one page at `address`, however often it is asked for; a page that was sent needs no server any more.

    Parameters
    ----------
    page : str
        The page.
    """

    def __init__(self, page: str) -> None:
        body, self.sent = page.encode(), threading.Event()
        sent = self.sent

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if self.path != "/":
                    self.send_error(404)
                    return
                try:
                    self.send_response(200)
                    self.send_header("Content-Type", "text/html; charset=utf-8")
                    self.send_header("Content-Length", str(len(body)))
                    self.end_headers()
                    self.wfile.write(body)
                except ConnectionError:
                    # the tab was closed meanwhile, and may ask again
                    return
                sent.set()

            def log_message(self, format: str, *args: object) -> None:
                """Say nothing of each request."""

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.address = f"http://127.0.0.1:{self._server.server_port}/"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def wait(self) -> None:
        """Wait for ever; a `KeyboardInterrupt` ends it."""
        threading.Event().wait()

    def close(self) -> None:
        """End the server."""
        self._server.shutdown()
        self._server.server_close()


def in_notebook() -> bool:
    """Return whether this program is the kernel of a notebook."""
    # where IPython runs it has been imported
    known = sys.modules.get("IPython")
    return hasattr(known.get_ipython() if known is not None else None, "kernel")


def inline(run: PlayableRun, speed: float = 1.0, shapes: str = "visual") -> None:
    """Show a run in a notebook, below the cell that calls this; the notebook keeps the page. See `replay`."""
    from IPython.display import HTML, display  # type: ignore[import-not-found,unused-ignore]

    page = html.escape(page_of(run, shapes, speed).html())
    frame = f'<iframe srcdoc="{page}" style="width: 100%; height: 480px; border: 0" title="replay"></iframe>'
    # IPython would advise against HTML that begins with a frame
    display(HTML(f"<div>{frame}</div>"))  # type: ignore[no-untyped-call,unused-ignore]


def replay(run: PlayableRun, speed: float = 1.0, shapes: str = "visual") -> ReplayServer:
    """Show a run in a browser; returns when the browser has the page, which can be opened again while the server runs.

    Parameters
    ----------
    run : PlayableRun
        The run to show.
    speed : float
        Seconds of the run per second of the replay at first.
    shapes : "visual" or "collision"
        See `Trajectory.replay_html`.

    Returns
    -------
    ReplayServer
        It ends with the program, or by `close`.

    Raises
    ------
    InputError
        If the run has no scene to show, the speed is not positive, or `shapes` is another word.
    """
    # written so that a NaN is refused too
    if not 0.0 < speed < float("inf"):
        raise InputError(f"speed must be positive and finite; got {speed}")
    server = ReplayServer(page_of(run, shapes, speed).html())
    print(f"the replay is at {server.address} as long as this program runs", flush=True)
    webbrowser.open(server.address)
    # a server that ended with the script before a browser has come would show nothing
    server.sent.wait()
    return server
