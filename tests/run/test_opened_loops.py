"""Errors of loops that cannot move as constraints demand name the loop, how far it opens, and what to change."""

import re

import pytest

import mbvi

SLIDER_CRANK = """<mujoco><worldbody>
<body name="crank"><joint name="turn" type="hinge" axis="0 1 0"/>
  <geom type="box" size=".1 .01 .01" pos=".1 0 0" mass="1"/>
  <body name="rod" pos=".2 0 0"><joint name="knee" type="hinge" axis="0 1 0"/>
    <geom type="box" size=".15 .01 .01" pos=".15 0 0" mass="1"/></body></body>
<body name="slider" pos=".5 0 0"><joint name="slide" type="slide" axis="1 0 0" limited="true" range="{limits}"/>
  <geom type="box" size=".02 .02 .02" mass="1" contype="0" conaffinity="0"/></body>
</worldbody><equality><connect name="pin" body1="rod" body2="slider" anchor=".3 0 0"/></equality></mujoco>"""


def slider_crank(tmp_path, limits):
    """It starts stretched: at a dead centre, where its slider can only move inwards."""
    file = tmp_path / "crank.xml"
    file.write_text(SLIDER_CRANK.format(limits=limits))
    scene = mbvi.Scene()
    scene.add_mjcf(file)
    return scene.build()


def test_a_slider_that_its_loop_cannot_move_outwards_names_the_loop(tmp_path):
    problem = slider_crank(tmp_path, "0 0.1")
    with pytest.raises(mbvi.InfeasibleError) as error:
        mbvi.simulate(problem, mbvi.SchatzmanPaoli(), step=1e-3, duration=0.1)
    words = str(error.value)
    found = re.search(r"crank_pin would stay open by (\S+) m or rad", words)
    # the fall of the crank within the step, of second order there
    assert found and 0.0 < float(found[1]) < 1e-6
    assert "change its lengths" in words and "joint limits" in words


def test_with_room_for_the_slider_it_moves(tmp_path):
    run = mbvi.simulate(slider_crank(tmp_path, "-0.1 0.1"), mbvi.SchatzmanPaoli(), step=1e-3, duration=0.1)
    assert run.loop_gap().max() < 1e-12


def test_a_start_that_opens_a_loop_names_it(tmp_path):
    problem = slider_crank(tmp_path, "-0.1 0.1")
    q = problem.q0.copy()
    q[-1] = 0.05
    with pytest.raises(mbvi.InadmissibleStartError, match=r"crank_pin is open by 0\.05; start where they close"):
        problem.at(q, problem.v0, check=True)
