"""Pictures and videos of a replay, and what is said where a program is missing."""

import shutil
import subprocess

import numpy as np
import pytest

import mbvi
from support.browser import distinct_colors, needs_browser, read_png


@pytest.fixture(scope="module")
def run():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.2, 0.2, 0.2), position=(0, 0, 0.5), angular_velocity=(1, 2, 3))
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.3, progress=False)


@needs_browser
def test_a_picture_is_of_its_instant(run, tmp_path):
    run.replay_video(tmp_path / "run.png", t=0.1)
    picture = read_png((tmp_path / "run.png").read_bytes())
    assert picture.shape == (720, 1280, 3) and distinct_colors(picture) > 500


@pytest.mark.slow
@needs_browser
@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no ffmpeg")
@pytest.mark.parametrize("kind", ["mp4", "gif"])
def test_a_video_has_as_many_pictures_as_its_time_says(kind, run, tmp_path):
    path = tmp_path / f"run.{kind}"
    run.replay_video(path, t=(0.1, 0.2), speed=0.5)
    said = subprocess.run(
        ["ffmpeg", "-i", str(path), "-f", "framemd5", "-"], capture_output=True, text=True, check=True
    ).stdout
    frames = [line for line in said.splitlines() if not line.startswith("#")]
    assert len(frames) == int(0.2 * {"mp4": 30, "gif": 20}[kind] + 1e-9) + 1
    assert len({line.split(",")[-1] for line in frames}) == len(frames)


@pytest.mark.parametrize(
    ("name", "given", "said"),
    [
        ("run.avi", {}, "ends with one of"),
        ("run.png", {"t": 7.0}, "outside the run"),
        ("run.png", {"t": (0.0, 0.1)}, "one instant"),
        ("run.gif", {"t": 0.1}, "a pair"),
        ("run.gif", {"t": (0.1, 0.2, 0.3)}, "a pair"),
        ("run.gif", {"t": (0.2, 0.1)}, "not be after"),
        ("run.mp4", {"t": np.nan}, "t "),
        ("run.mp4", {"speed": 0.0}, "speed"),
    ],
)
def test_a_wrong_call_is_refused(name, given, said, run, tmp_path):
    with pytest.raises(mbvi.InputError, match=said):
        run.replay_video(tmp_path / name, **given)
    assert not list(tmp_path.iterdir())


def test_a_missing_program_is_named(run, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(mbvi.InputError, match="need Chromium"):
        run.replay_video(tmp_path / "run.png")
    monkeypatch.setattr(shutil, "which", lambda name: "/bin/true" if name == "chromium" else None)
    with pytest.raises(mbvi.InputError, match=r"needs ffmpeg; \.gif and \.png need none"):
        run.replay_video(tmp_path / "run.mp4")
    assert not list(tmp_path.iterdir())
