"""What `Problem` demands of a state, at every place where users give one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from support.paths import ROBOTS

WHEEL = """<robot name="wheel"><link name="base"/><link name="rim"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axle" type="continuous"><parent link="base"/><child link="rim"/><axis xyz="0 1 0"/></joint></robot>"""


def bodies(plane=None):
    scene = mbvi.Scene(plane=plane)
    scene.add_box((1, 1, 1), name="one")
    scene.add_box((1, 1, 1), position=(3, 0, 0), name="two")
    return scene.build()


def robot(plane=None):
    scene = mbvi.Scene(plane=plane)
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf")
    scene.add_box((1, 1, 1), position=(9, 0, 0))
    return scene.build()


@pytest.fixture(scope="module")
def problems(tmp_path_factory):
    file = tmp_path_factory.mktemp("wheel") / "wheel.urdf"
    file.write_text(WHEEL)
    scene = mbvi.Scene()
    scene.add_urdf(file, base="fixed")
    return [bodies(), bodies("xz"), robot(), scene.build()]


def takers(problem):
    """Return functions of (q, v), one for each place that takes a state, and each raises if it is none."""

    def first_of_rollout(q, v):
        (error,) = mbvi.rollout(problem, q[None], v[None], steps=1).errors
        if error is not None:
            raise error

    families = problem.constraints.constraints
    return {
        "Problem": lambda q, v: mbvi.Problem(problem.system, families, q, v),
        "at": problem.at,
        "checked": lambda q, v: problem.at(q, v, check=True),
        "reset": mbvi.Simulator(problem, mbvi.Paoli(), step=1e-3).reset,
        "rollout": first_of_rollout,
    }


@pytest.mark.parametrize("place", ["Problem", "at", "checked", "reset", "rollout"])
def test_a_rotation_of_zeros_is_refused_everywhere(problems, place):
    for problem in problems:
        take, groups = takers(problem)[place], problem.system.unit_groups()
        assert groups
        take(problem.q0.copy(), problem.v0.copy())
        for rotation in np.concatenate(groups):
            for size in (0.0, 1e-9, 1e-200, 1.001):
                q = problem.q0.copy()
                q[rotation] *= size
                with pytest.raises(mbvi.InputError, match="unit length"):
                    take(q, problem.v0.copy())


@settings(max_examples=200, deadline=None)
@given(size=st.one_of(st.floats(-3.0, 3.0), st.floats(-1e-5, 1e-5).map(lambda x: 1.0 + x)))
def test_a_rotation_is_taken_if_and_only_if_its_length_is_one(problems, size):
    off = abs(abs(size) - 1.0)
    for problem in problems:
        q = problem.q0.copy()
        q[problem.system.unit_groups()[0][0]] *= size
        if off < 9e-7:
            problem.at(q, problem.v0)
        elif off > 3e-6:
            with pytest.raises(mbvi.InputError, match="unit length"):
                problem.at(q, problem.v0)
