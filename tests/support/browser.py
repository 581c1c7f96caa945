"""Chromium without a window: pictures of a replay page, and what scripts in it say."""

import os
import re
import shutil
import struct
import subprocess
import zlib

import numpy as np
import pytest

CHROMIUM = shutil.which("chromium")
# where a browser is required, tests without one fail instead of being skipped
BROWSER = CHROMIUM is not None or bool(os.environ.get("MBVI_REQUIRE_BROWSER"))
FLAGS = (
    "--headless --no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync --disable-quic "
    "--enable-logging=stderr --v=0 --window-size=420,300"
).split()
WIDTH, HEIGHT = 420, 300

needs_browser = pytest.mark.skipif(not BROWSER, reason="no chromium")


def chromium(folder):
    """Return the command that starts the browser, with a profile of its own in a folder."""
    assert CHROMIUM is not None, "MBVI_REQUIRE_BROWSER is set, but there is no chromium"
    return [CHROMIUM, *FLAGS, f"--user-data-dir={folder / 'profile'}", "--host-resolver-rules=MAP * ~NOTFOUND"]


def with_script(page, script):
    """Return the address of a copy of a page that runs a script at its end."""
    copy = page.with_name("copy.html")
    copy.write_text(
        page.read_text(encoding="utf-8").replace("</body>", f"<script>{script}</script></body>"), encoding="utf-8"
    )
    return copy.as_uri()


def look(page, at):
    """Return a picture of a page held at an instant, shape (h, w, 3)."""
    hold = f"animator.play(); animator.pause(); animator.play = () => 0; animator.seek({at}); animator.time = {at};"
    picture = page.with_name("picture.png")
    what = ["--virtual-time-budget=1000", f"--screenshot={picture}", with_script(page, hold)]
    done = subprocess.run([*chromium(page.parent), *what], capture_output=True, text=True, timeout=120, check=True)
    assert not [line for line in done.stderr.splitlines() if re.search("CONSOLE.*(Uncaught|Error|THREE|Failed)", line)]
    return read_png(picture.read_bytes())


def distinct_colors(picture):
    return len(np.unique(picture.reshape(-1, 3), axis=0))


def read_png(data):
    """Return the pixels of an 8-bit PNG without interlacing, shape (h, w, 3)."""
    width, height, depth, kind, _, _, interlace = struct.unpack(">IIBBBBB", data[16:29])
    assert (depth, interlace) == (8, 0)
    step = {2: 3, 6: 4}[kind]
    packed, at = b"", 8
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        if data[at + 4 : at + 8] == b"IDAT":
            packed += data[at + 8 : at + 8 + length]
        at += length + 12
    raw, rows = zlib.decompress(packed), [bytearray(width * step)]
    for start in range(0, len(raw), 1 + width * step):
        rows.append(unfiltered(raw[start], bytearray(raw[start + 1 : start + 1 + width * step]), rows[-1], step))
    return np.frombuffer(b"".join(rows[1:]), np.uint8).reshape(height, width, step)[:, :, :3]


def unfiltered(kind, row, above, step):
    for k in range(len(row)):
        left, up, corner = (row[k - step], above[k], above[k - step]) if k >= step else (0, above[k], 0)
        if kind == 4:
            guess = left + up - corner
            row[k] = (row[k] + min((left, up, corner), key=lambda x: abs(guess - x))) & 255
        else:
            row[k] = (row[k] + (0, left, up, (left + up) // 2)[kind]) & 255
    return row
