"""Robots by name come from the cache of robot_descriptions; nothing is downloaded."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import mbvi
from mbvi.scene.urdf.robot_names import description_file, format_of
from support.paths import REAL_ROBOTS

pytest.importorskip("robot_descriptions")
pytest.importorskip("git")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Return an empty cache; nothing that was read from another one is kept."""
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path))
    monkeypatch.delenv("ROBOT_DESCRIPTION_COMMIT", raising=False)
    for name in list(sys.modules):
        if name.startswith("robot_descriptions."):
            monkeypatch.delitem(sys.modules, name)
    return tmp_path


def filled(folder: Path) -> None:
    """Put the URDF and the meshes of solo into a repository in the layout of example-robot-data."""
    for part in ("solo_description/robots", "solo_description/meshes"):
        shutil.copytree(REAL_ROBOTS / part, folder / "robots" / part)
    git = ("git", "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@b")
    for words in (("init", "-q"), ("add", "."), ("commit", "-q", "-m", "all"), ("tag", "local")):
        subprocess.run([*git, *words], check=True, capture_output=True)


def test_a_robot_in_the_cache_is_read(cache, monkeypatch):
    monkeypatch.setenv("ROBOT_DESCRIPTION_COMMIT", "local")
    filled(cache / "example-robot-data-local" / "example-robot-data")
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf("robot:solo_description", position=(0, 0, 0.6))
    problem = scene.build()
    assert problem.system.nv == 18
    with pytest.raises(mbvi.InputError, match="solo_description is URDF, not MJCF: use add_urdf"):
        scene.add_mjcf("robot:solo_description")


def test_a_robot_that_is_not_there_names_the_command(cache):
    with pytest.raises(mbvi.InputError, match="python -m robot_descriptions pull go2_description"):
        mbvi.Scene().add_urdf("robot:go2_description")
    with pytest.raises(mbvi.InputError, match="python -m robot_descriptions pull go2_mj_description"):
        mbvi.Scene().add_mjcf("robot:go2_mj_description")
    assert not list(cache.iterdir())


def test_another_version_in_the_cache_is_refused(cache):
    filled(cache / "example-robot-data")
    with pytest.raises(mbvi.InputError, match="another version of solo_description"):
        mbvi.Scene().add_urdf("robot:solo_description")


def test_a_folder_that_is_no_repository_is_refused(cache):
    (cache / "example-robot-data").mkdir()
    with pytest.raises(mbvi.InputError, match="another version of solo_description"):
        mbvi.Scene().add_urdf("robot:solo_description")


def test_unknown_names_are_refused_with_similar_ones(cache):
    with pytest.raises(mbvi.InputError, match="no 'go2'; similar are go2_description"):
        mbvi.Scene().add_urdf("robot:go2")
    for name in ("", "none_such", "../x"):
        with pytest.raises(mbvi.InputError, match="robot_descriptions has no"):
            mbvi.Scene().add_urdf(f"robot:{name}")


def test_a_robot_that_mbvi_ships_is_found_by_its_name(monkeypatch):
    monkeypatch.setitem(sys.modules, "robot_descriptions._descriptions", None)
    assert description_file("robot:hopper", "URDF") == mbvi.robot("hopper")
    assert format_of("robot:hopper") == "URDF"
    with pytest.raises(mbvi.InputError, match="hopper is URDF, not MJCF: use add_urdf"):
        mbvi.Scene().add_mjcf("robot:hopper")


def test_without_the_package_the_error_names_the_extra(cache, monkeypatch):
    monkeypatch.setitem(sys.modules, "robot_descriptions._descriptions", None)
    with pytest.raises(mbvi.InputError, match=r"mbvi ships arm, .*: pip install 'mbvi\[robots\]'"):
        mbvi.Scene().add_urdf("robot:go2_description")
