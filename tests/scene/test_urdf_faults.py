"""Robot descriptions with faults: each is refused by an `MbviError`, or runs; none ends or holds up the process."""

from __future__ import annotations

import numpy as np
import pytest

import mbvi
from mbvi.scene.urdf.visuals import visual_shapes
from support.faults import mutated_robots as faults
from support.paths import ROBOTS

HOPPER = (ROBOTS / "hopper" / "hopper.urdf").read_text()
PENDULUM = (ROBOTS / "double_pendulum" / "double_pendulum.urdf").read_text()


def check(folder, seeds):
    cases = [faults.mutation(np.random.default_rng(seed)) for seed in seeds]
    found = faults.outcomes(folder, cases)
    assert not faults.wrong(found)
    # both bases of each were tried, some were taken and some refused
    assert len(found) == 2 * len(cases)
    kinds = [outcome for _, outcome in found]
    assert 0.1 < kinds.count("taken") / len(kinds) < 0.6
    assert 0.3 < kinds.count("UrdfError") / len(kinds) < 0.9


def test_mutated_robots(tmp_path):
    check(tmp_path, range(60))


@pytest.mark.slow(seconds=12)
def test_many_mutated_robots(tmp_path):
    check(tmp_path, range(10_500, 11_000))


def test_a_robot_that_ends_the_process_is_found(tmp_path):
    """The driver says so, and goes on with the next one: here each process is ended by its own alarm."""
    good = HOPPER.encode()
    program = tmp_path / "child.py"
    program.write_text(
        "import os, sys, signal; from support.faults import mutated_robots as f; f.attempt = lambda path, base: "
        "os.kill(os.getpid(), signal.SIGSEGV) if path.name == '000001.urdf' else 'taken'; f.main(*sys.argv[1:])"
    )
    folder = tmp_path / "robots"
    folder.mkdir()
    found = faults.outcomes(folder, [(f"case {k}", good) for k in range(3)], program)
    assert [outcome for _, outcome in found if outcome != "taken"] == [found[2][1]]
    assert found[2][1].startswith("killed -11") and "case 1" in found[2][0] and len(found) == 5
    assert faults.wrong(found) == [found[2]]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('rgba="0.95 0.5 0.16 1"', 'rgba="abc"', "<color rgba='abc'>: not numbers"),
        ('rgba="0.95 0.5 0.16 1"', 'rgba="0.5 0.5 0.5"', "4 numbers expected, 3 found"),
        ('radius="0.036"', 'radius="-0.0"', "lengths of shapes must be positive"),
        ('size="0.24 0.15 0.1"', 'size="0.24 nan 0.1"', "not finite"),
        ('radius="0.036"', 'radius="1e39"', "reaches 1e[+]39 m; shapes may reach 1e[+]18 m at most"),
        ('ixx="0.00692537"', 'ixx="1e308"', "larger than 1e[+]40"),
        ('ixx="0.00692537"', 'ixx="seven"', "not a number"),
        ('mass value="2.4"', 'mass value="1e-300"', "smaller than 1e-40"),
        ('lower="-1.2"', 'lower="nan"', "not finite"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', "joint 'hip': its axis must not be zero"),
    ],
)  # fmt: skip
def test_numbers_that_no_robot_has(tmp_path, old, new, message):
    assert old in HOPPER
    path = tmp_path / "hopper.urdf"
    path.write_text(HOPPER.replace(old, new))
    with pytest.raises(mbvi.UrdfError, match=message):
        mbvi.Scene().add_urdf(path)


def test_limits_may_be_the_largest_float(tmp_path):
    """Which is how some files write that there is none."""
    path = tmp_path / "hopper.urdf"
    path.write_text(
        HOPPER.replace('lower="-1.2" upper="1.2" effort="30"', f'lower="-1e308" upper="1e308" effort="{1e300}"')
    )
    scene = mbvi.Scene()
    scene.add_urdf(path)
    problem = scene.build()
    names = [problem.constraints.name(k) for k in range(len(problem.constraints))]
    assert [n for n in names if "limit" in n] == ["hopper/knee lower limit", "hopper/knee upper limit"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16", "iso-8859-15"])
def test_names_are_read_in_the_encoding_that_a_file_declares(tmp_path, encoding):
    declared = {"utf-8-sig": "utf-8"}.get(encoding, encoding)
    text = PENDULUM.replace("double_pendulum", "pendule_\u00e0_deux", 1).partition("?>")[2]
    text = text.replace("lower_link", "bras_\u00e9")
    path = tmp_path / "robot.urdf"
    path.write_bytes(f'<?xml version="1.0" encoding="{declared}"?>{text}'.encode(encoding))
    scene = mbvi.Scene()
    assert scene.add_urdf(path, base="fixed") == "pendule_\u00e0_deux"
    # its text is read again for forces at centres of mass, and for what is shown
    scene.add_force("pendule_\u00e0_deux/bras_\u00e9", lambda t, q, v: [1.0, 0, 0, 0, 0, 0])
    run = mbvi.simulate(scene.build(), step=1e-3, duration=0.01)
    run.replay_html(tmp_path / "run.html")
    assert any("bras_\u00e9" in shape.name for shape in visual_shapes(run.problem.scene)[0])
    path.write_bytes(f'<?xml version="1.0" encoding="utf-8"?>{text}'.encode("latin-1"))
    with pytest.raises(mbvi.UrdfError, match="encoding that it declares"):
        mbvi.Scene().add_urdf(path, base="fixed")
