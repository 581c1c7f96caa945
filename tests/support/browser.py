"""Chromium without a window: pictures of a replay page, clicks on it, and what its script says."""

import os
import struct
import zlib

import numpy as np
import pytest

from mbvi.errors import InputError
from mbvi.results.replay.browser import chromium, page_address


def _installed():
    try:
        return bool(chromium())
    except InputError:
        return False


# where a browser is required, tests without one fail instead of being skipped
BROWSER = _installed() or bool(os.environ.get("MBVI_REQUIRE_BROWSER"))
WIDTH, HEIGHT = 640, 460

needs_browser = pytest.mark.skipif(not BROWSER, reason="no chromium")


def shown(browser, page):
    """Open a page that does not play by itself, and wait until it is ready."""
    browser.resize(WIDTH, HEIGHT)
    browser.open(page_address(page), "replay.ready")
    browser.evaluate("replay.autoplay = false; replay.pause()")
    return browser


def look(browser, at):
    """Return a picture of the open page at an instant since its start, shape (h, w, 3); its console has no error."""
    browser.evaluate(f"replay.seek({at}), viewer.render()")
    picture = read_png(browser.picture())
    assert not browser.errors
    return picture


def click(browser, selector, along=0.5):
    """Click on an element with the mouse, at some part of its width."""
    x, y = browser.evaluate(
        f"(box => [box.x + {along} * box.width, box.y + box.height / 2])"
        f"(document.querySelector({selector!r}).getBoundingClientRect())"
    )
    for kind in ("mousePressed", "mouseReleased"):
        browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)


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
