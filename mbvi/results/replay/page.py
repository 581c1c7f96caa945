"""One HTML page that holds the viewer, the scene, and the poses that its own script plays."""

from __future__ import annotations

import base64
import json
import re
from html import escape
from pathlib import Path
from typing import Any, Protocol

import umsgpack  # type: ignore[import-untyped]
from meshcat.servers.zmqserver import VIEWER_ROOT

_IDENTITY = re.compile(rb"[0-9a-f]{8}-[0-9a-f]{4}-1[0-9a-f]{3}-[0-9a-f]{4}-[0-9a-f]{12}")
_PARTS = ("page.html", "page.css", "player.js", "camera.js", "panel.js")


class Command(Protocol):
    """What meshcat sends to its viewer."""

    def lower(self) -> dict[str, object]:
        """Return the command as the viewer reads it."""
        ...


class Page:
    """Takes the place of meshcat's window and keeps what is sent to it.

    meshcat's own static page is not used: it needs a server and runs its commands in any order.

    Attributes
    ----------
    commands : list of dict
        What meshcat's viewer is told.
    data : dict
        What the script of the page plays.
    title : str
        The title of the page.
    """

    def __init__(self) -> None:
        self.commands: list[dict[str, object]] = []
        self.data: dict[str, Any] = {}
        self.title = "mbvi replay"

    def send(self, command: Command) -> None:
        """Keep a command."""
        self.commands.append(command.lower())

    def html(self) -> str:
        """Return the page, the same for the same commands and data."""
        return written(self.content())

    def content(self) -> dict[str, Any]:
        """Return what is shown, without the viewer and the scripts: numbers, text, lists and dicts of these."""
        numbers: dict[bytes, bytes] = {}

        def number(match: re.Match[bytes]) -> bytes:
            # meshcat names objects by clock and network card
            return numbers.setdefault(match[0], b"%036d" % len(numbers))

        packed = [_IDENTITY.sub(number, umsgpack.packb(command)) for command in self.commands]
        texts = [base64.b64encode(one).decode() for one in packed]
        return {"title": self.title, "commands": texts, "data": self.data}


def written(content: dict[str, Any], viewer: str = "") -> str:
    """Return the page of what `Page.content` returned, with the viewer inside, or as a script at another address."""
    page, style, *scripts = (Path(__file__).with_name(name).read_text(encoding="utf-8") for name in _PARTS)
    # "<" begins no tag within a script
    data = json.dumps(content["data"]).replace("<", "\\u003c")
    script = f"const COMMANDS = {json.dumps(content['commands'])};\nconst DATA = {data};\n" + "".join(scripts)
    page = page.replace("@TITLE@", escape(content["title"])).replace("@STYLE@", style).replace("@SCRIPT@", script)
    if viewer:
        return page.replace("<script>@VIEWER@", f'<script src="{escape(viewer)}">')
    return page.replace("@VIEWER@", viewer_script())


def viewer_script() -> str:
    """Return meshcat's viewer."""
    return Path(VIEWER_ROOT, "main.min.js").read_text(encoding="utf-8")
