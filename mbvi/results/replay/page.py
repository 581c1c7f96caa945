"""One HTML page that holds the viewer, the scene and its animation."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import umsgpack  # type: ignore[import-untyped]
from meshcat.servers.zmqserver import VIEWER_ROOT

_IDENTITY = re.compile(rb"[0-9a-f]{8}-[0-9a-f]{4}-1[0-9a-f]{3}-[0-9a-f]{4}-[0-9a-f]{12}")

# bytes from which on an array is stored once for all commands that have it
_LARGE = 1024

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>mbvi replay</title>
<style>
body { margin: 0; overflow: hidden; font: 14px sans-serif; color: #345; }
#meshcat-pane { width: 100vw; height: 100vh; overflow: hidden; }
#bar { position: absolute; left: 5vw; bottom: 1em; width: 90vw; display: flex; gap: 1em; align-items: center; }
#bar button { width: 4.5em; font: inherit; color: inherit; }
#bar input { flex: 1; }
#bar output { width: 8em; text-align: right; font-variant-numeric: tabular-nums; }
</style>
</head>
<body>
<div id="meshcat-pane"></div>
<div id="bar"><button></button><input type="range" min="0" step="any" value="0"><output></output>@TOGGLE@</div>
<script>@VIEWER@</script>
<script>
const viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
// each command is the bytes of some chunks, of which large ones may be in several
const chunks = @CHUNKS@;
for (const parts of @COMMANDS@) {
    const text = parts.map(k => atob(chunks[k])).join(""), bytes = new Uint8Array(text.length);
    for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
    viewer.handle_command_bytearray(bytes);
}
const animator = viewer.animator;
const [button, slider, clock] = document.getElementById("bar").children;
slider.max = animator.duration;
button.onclick = () => animator.playing ? animator.pause() : animator.play();
slider.oninput = () => { animator.seek(Number(slider.value)); animator.time = Number(slider.value); };
function show() {
    button.textContent = animator.playing ? "Pause" : "Play";
    slider.value = animator.time;
    clock.textContent = `${animator.time.toFixed(3)} s`;
    requestAnimationFrame(show);
}
show();
// the first picture takes long: time starts after it
requestAnimationFrame(() => requestAnimationFrame(() => animator.play()));
@SWITCH@</script>
</body>
</html>
"""


# of pages with friction: whether cones are shown, and what the colors mean
_TOGGLE = (
    '<label style="white-space: nowrap"><input type="checkbox" id="cones" checked>friction cones</label>'
    '<span style="color: #1565c0">stick</span><span style="color: #d81b4a">slip</span>'
)
_SWITCH = """const cones = document.getElementById("cones");
cones.onchange = () => viewer.set_property(["meshcat", "friction"], "visible", cones.checked);
"""


class Command(Protocol):
    """What meshcat sends to its viewer."""

    def lower(self) -> dict[str, object]:
        """Return the command as the viewer reads it."""
        ...


class Page:
    """Takes the place of meshcat's window and keeps what is sent to it.

    meshcat's own static page is not used: it needs a server and runs its commands in any order.
    """

    def __init__(self) -> None:
        self.commands: list[dict[str, object]] = []

    def send(self, command: Command) -> None:
        """Keep a command."""
        self.commands.append(command.lower())

    def html(self) -> str:
        """Return the page, the same for the same commands."""
        numbers: dict[bytes, bytes] = {}

        def number(match: re.Match[bytes]) -> bytes:
            return numbers.setdefault(match[0], b"%036d" % len(numbers))

        chunks: dict[bytes, int] = {}
        commands = []
        for command in self.commands:
            left, parts = umsgpack.packb(command), []
            for array in _large_arrays(command):
                before, _, left = left.partition(array)
                parts += [_IDENTITY.sub(number, before), array]
            # meshcat names objects by clock and network card
            parts.append(_IDENTITY.sub(number, left))
            commands.append([chunks.setdefault(part, len(chunks)) for part in parts])
        texts = json.dumps([base64.b64encode(data).decode() for data in chunks])
        viewer = Path(VIEWER_ROOT, "main.min.js").read_text(encoding="utf-8")
        friction = any("/friction/" in str(command.get("path")) for command in self.commands)
        page = _PAGE.replace("@TOGGLE@", _TOGGLE if friction else "").replace("@SWITCH@", _SWITCH if friction else "")
        page = page.replace("@COMMANDS@", json.dumps(commands)).replace("@CHUNKS@", texts)
        return page.replace("@VIEWER@", viewer)


def _large_arrays(value: object) -> Iterator[bytes]:
    """Yield the arrays of a command that are worth sharing, in the order they are packed in."""
    if isinstance(value, dict):
        for inner in value.values():
            yield from _large_arrays(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _large_arrays(inner)
    elif isinstance(value, umsgpack.Ext) and len(value.data) >= _LARGE:
        yield value.data
