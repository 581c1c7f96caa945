"""Pictures and videos of a replay: the page in Chromium, one picture an instant."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...arguments import watched
from ...errors import InputError, TrajectoryFileError
from .browser import Browser, chromium, page_address
from .replay import replay_html

if TYPE_CHECKING:
    from .motion import Array, PlayableRun

# pixels, even as ffmpeg wants them; pictures a second
_WIDTH, _HEIGHT = 1280, 720
_RATES = {".mp4": 30, ".gif": 20}
_FORMATS = (".png", ".gif", ".mp4")


def replay_video(
    run: PlayableRun,
    path: Path,
    t: float | tuple[float, float] | None = None,
    speed: float = 1.0,
    shapes: str = "visual",
) -> None:
    """Write a picture or a video of a run; see `Trajectory.replay_video`."""
    start, end = float(run.t[0]), float(run.t[-1])
    given = t if isinstance(t, tuple) else () if t is None else (t,)
    if not all(start <= one <= end for one in given):
        raise InputError(f"t = {t} lies outside the run, [{start:g}, {end:g}] s")
    kind = path.suffix.lower()
    if kind not in _FORMATS:
        raise InputError(f"the name of a video ends with one of {', '.join(_FORMATS)}; got {path.name}")
    instants = _instants(run, t, kind, speed)
    chromium()
    if kind == ".mp4" or (kind == ".gif" and find_spec("PIL") is None):
        _ffmpeg(kind)
    try:
        path.touch()
    except OSError as error:
        raise TrajectoryFileError(f"the video {path} cannot be written: {error.strerror or error}") from error
    taken = pictures(run, instants, shapes)
    if kind == ".png":
        path.write_bytes(next(taken))
    elif kind == ".gif" and find_spec("PIL") is not None:
        _write_gif(path, taken)
    else:
        _write_by_ffmpeg(path, taken, kind)


def _instants(run: PlayableRun, t: float | tuple[float, float] | None, kind: str, speed: float) -> Array:
    """Return the instants of the pictures since the start of the run [s]."""
    start, end = float(run.t[0]), float(run.t[-1])
    if kind == ".png":
        if isinstance(t, tuple):
            raise InputError("t of a picture is one instant; a span of time needs .mp4 or .gif")
        given = np.array([end if t is None else t])
    else:
        if t is not None and not isinstance(t, tuple):
            raise InputError("t of a video is a pair, its first and its last instant; one instant needs .png")
        first, last = (start, end) if t is None else t
        if first > last:
            raise InputError(f"the first instant of a video must not be after the last; got t = ({first}, {last})")
        count = int((last - first) / speed * _RATES[kind]) + 1
        given = first + np.arange(count) * speed / _RATES[kind]
    return np.minimum(given, end) - start


def pictures(
    run: PlayableRun, instants: Array, shapes: str = "visual", width: int = _WIDTH, height: int = _HEIGHT
) -> Iterator[bytes]:
    """Yield the replay at some instants since the start of the run [s], as PNG, without its controls."""
    with tempfile.TemporaryDirectory() as folder, Browser(width, height) as browser:
        page = Path(folder) / "run.html"
        replay_html(run, page, shapes)
        browser.open(page_address(page), "replay.ready")
        browser.evaluate("replay.still()")
        for time in watched(instants.tolist(), "pictures"):
            browser.evaluate(f"replay.seek({time!r}), viewer.render()")
            yield browser.picture()


def _write_gif(path: Path, taken: Iterator[bytes]) -> None:
    from PIL import Image

    images = [Image.open(io.BytesIO(one)).convert("P", palette=Image.Palette.ADAPTIVE) for one in taken]
    images[0].save(path, save_all=True, append_images=images[1:], duration=1000 // _RATES[".gif"], loop=0)


def _ffmpeg(kind: str) -> str:
    found = shutil.which("ffmpeg")
    if found is None:
        instead = " or pillow" if kind == ".gif" else "; .gif and .png need none"
        raise InputError(f"a {kind} needs ffmpeg{instead}, and none is installed")
    return found


def _write_by_ffmpeg(path: Path, taken: Iterator[bytes], kind: str) -> None:
    command = [
        _ffmpeg(kind),
        "-y",
        "-loglevel",
        "error",
        "-f",
        "image2pipe",
        "-framerate",
        str(_RATES[kind]),
        "-i",
        "-",
    ]
    if kind == ".mp4":
        command += ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    with tempfile.TemporaryFile() as said:
        with subprocess.Popen([*command, os.fspath(path)], stdin=subprocess.PIPE, stderr=said) as process:
            assert process.stdin is not None
            try:
                for one in taken:
                    process.stdin.write(one)
            except BrokenPipeError:
                # ffmpeg has ended, and says why
                pass
        if process.returncode:
            said.seek(0)
            raise TrajectoryFileError(f"ffmpeg could not write {path}: {said.read().decode(errors='replace').strip()}")
