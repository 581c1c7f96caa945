"""Chromium without a window, told what to do by its DevTools protocol."""

from __future__ import annotations

import asyncio
import base64
import json
import re
import shutil
import subprocess
import tempfile
import threading
import time
import urllib.request
from pathlib import Path
from types import TracebackType
from typing import Any

from tornado.httpclient import HTTPRequest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from ...errors import InputError, MbviError

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
# WebGL is computed by software, which every machine has
_FLAGS = (
    "--headless --no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync --disable-quic --hide-scrollbars "
    "--remote-debugging-port=0 about:blank"
).split()
# [s]: until the browser has started, and for one answer
_START, _ANSWER = 60.0, 120.0


def chromium() -> str:
    """Return the command of an installed Chromium.

    Raises
    ------
    InputError
        If there is none.
    """
    found = next((path for name in _NAMES if (path := shutil.which(name))), None)
    if found is None:
        raise InputError("pictures and videos of a replay need Chromium, and none is installed; replay_html needs none")
    return found


class Browser:
    """A headless Chromium with one page; use it in a `with` statement.

    Parameters
    ----------
    width, height : int
        Size of the window [pixels].

    Attributes
    ----------
    errors : list of str
        Errors that the page has written to the console since it was opened.
    """

    def __init__(self, width: int, height: int) -> None:
        self._size, self.errors, self._count = (width, height), list[str](), 0

    def __enter__(self) -> Browser:
        self._folder = tempfile.TemporaryDirectory(prefix="mbvi-", ignore_cleanup_errors=True)
        command = [chromium(), f"--user-data-dir={self._folder.name}", *_FLAGS]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self._loop = asyncio.new_event_loop()
        try:
            address = self._address()
            self._socket = self._loop.run_until_complete(_connected(address))
            for domain in ("Page", "Runtime", "Log"):
                self.call(f"{domain}.enable")
            self.resize(*self._size)
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.terminate()
        self._process.wait()
        if hasattr(self, "_socket"):
            self._socket.close()
            self._loop.run_until_complete(asyncio.sleep(0))
        self._loop.close()
        assert self._process.stderr is not None
        if not hasattr(self, "_drain"):
            self._process.stderr.close()
        else:
            self._drain.join()
        self._folder.cleanup()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the DevTools protocol and return its result."""
        self._count += 1
        message = json.dumps({"id": self._count, "method": method, "params": parameters})
        return self._loop.run_until_complete(asyncio.wait_for(self._answer(message), _ANSWER))

    def resize(self, width: int, height: int) -> None:
        """Set the size of the window [pixels]."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def open(self, address: str, until: str = "true") -> None:
        """Open a page and wait until an expression of it is true.

        Raises
        ------
        MbviError
            If that takes longer than a minute.
        """
        self.errors.clear()
        self.call("Page.navigate", url=address)
        self.wait(until)

    def wait(self, until: str) -> None:
        """Wait until an expression of the page is true; see `open`."""
        end = time.monotonic() + _START
        while not self.evaluate(f"(() => {{ try {{ return Boolean({until}); }} catch {{ return false; }} }})()"):
            if time.monotonic() > end:
                raise MbviError(
                    f"the page did not get ready in Chromium; it says: {'; '.join(self.errors) or 'nothing'}"
                )
            time.sleep(0.02)

    def evaluate(self, expression: str) -> Any:
        """Return the value of an expression of the page, promises awaited."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            self.errors.append(str(answer["exceptionDetails"].get("exception", {}).get("description")))
        return answer["result"].get("value")

    def picture(self) -> bytes:
        """Return the window as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def _address(self) -> str:
        """Return the address of the page's socket, once the browser has started."""
        assert self._process.stderr is not None
        stopper = threading.Timer(_START, self._process.kill)
        stopper.start()
        port = next(
            (found[1] for line in self._process.stderr if (found := re.search(r"ws://[^:]+:(\d+)/", line))), None
        )
        stopper.cancel()
        if port is None:
            raise MbviError("Chromium did not start")
        # a full pipe would stop the browser
        self._drain = threading.Thread(target=_drained, args=(self._process.stderr,), daemon=True)
        self._drain.start()
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=_START) as answer:
            pages = json.load(answer)
        return str(next(page["webSocketDebuggerUrl"] for page in pages if page["type"] == "page"))

    async def _answer(self, message: str) -> dict[str, Any]:
        await self._socket.write_message(message)
        while True:
            text = await self._socket.read_message()
            if text is None:
                raise MbviError("Chromium ended unexpectedly")
            told = json.loads(text)
            self._note(told)
            if told.get("id") == self._count:
                if "error" in told:
                    raise MbviError(f"Chromium refused: {told['error'].get('message')}")
                return dict(told["result"])

    def _note(self, told: dict[str, Any]) -> None:
        """Keep what is an error on the console."""
        method, about = told.get("method"), told.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(str(about["exceptionDetails"].get("exception", {}).get("description")))
        elif method == "Runtime.consoleAPICalled" and about["type"] in ("error", "assert"):
            self.errors.append(" ".join(str(one.get("value", one.get("description"))) for one in about["args"]))
        elif method == "Log.entryAdded" and about["entry"]["level"] == "error":
            self.errors.append(str(about["entry"]["text"]))


async def _connected(address: str) -> WebSocketClientConnection:
    # pictures are larger than the default
    return await websocket_connect(HTTPRequest(address, connect_timeout=_START), max_message_size=1 << 28)


def _drained(stream: Any) -> None:
    for _ in stream:
        pass
    stream.close()


def page_address(path: Path) -> str:
    """Return the address of a file for the browser."""
    return path.resolve().as_uri()
