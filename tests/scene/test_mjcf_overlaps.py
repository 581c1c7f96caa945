"""Bodies of a MJCF that touch or overlap where it puts them: parts of one mechanism pass, others carry each other."""

import numpy as np
import pytest

import mbvi
from support.beside_mujoco import scene_of

pytest.importorskip("mujoco")

# the arm is made to reach into its table
STACK = """<mujoco model="stack"><worldbody><geom name="floor" type="plane" size="5 5 1"/>
  <body name="table" pos="0 0 .5"><geom type="box" size=".5 .5 .05"/>
    <body name="arm" pos=".4 0 0"><joint axis="0 1 0"/><geom type="box" size=".05 .05 .2"/></body></body>
  <body name="lower" pos="0 0 .65"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
  <body name="upper" pos="0 0 {height}"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody>
  <keyframe><key name="home" qpos="0 0 0 .65 1 0 0 0 0 0 .85 1 0 0 0"/></keyframe></mujoco>"""


@pytest.mark.parametrize(("height", "keyframe"), [(".85", None), (".7", "home")])
def test_what_touches_at_the_start_is_carried(height, keyframe, tmp_path):
    # in the second file the boxes overlap, and the keyframe parts them
    scene, _, _ = scene_of(STACK.format(height=height), tmp_path, keyframe=keyframe)
    run = mbvi.simulate(scene.build(), step=1e-3, duration=0.2)
    np.testing.assert_allclose(run.q[-1, [3, 10]], [0.65, 0.85], rtol=0, atol=1e-9)
    assert "pair stack/table | stack/arm: overlap at the file's configuration" in run.problem.report()


def test_bodies_that_overlap_at_the_start_are_refused_or_moved_apart(tmp_path):
    scene, _, _ = scene_of(STACK.format(height=".84"), tmp_path)
    with pytest.raises(mbvi.InadmissibleStartError, match=r"lower \| stack/upper penetrates by 0.01 m.*resolve=True"):
        scene.build()
    moved = scene.build(resolve=True).q0
    np.testing.assert_allclose(moved[10] - moved[3], 0.2, rtol=0, atol=1e-9)
