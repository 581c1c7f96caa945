"""Poses as bytes: what is decoded is what was encoded, within the promised error."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mbvi.results.replay.encoding import decode, encode

NONE = np.zeros((0, 3))
coordinates = st.floats(-1e6, 1e6, allow_nan=False, width=64)
sizes = st.tuples(st.integers(1, 6), st.integers(0, 5))


@st.composite
def poses(draw):
    frames, count = draw(sizes)
    position = draw(arrays(float, (frames, count, 3), elements=coordinates)) * draw(st.sampled_from([1e-6, 1.0, 1e3]))
    quaternion = draw(arrays(float, (frames, count, 4), elements=st.floats(-1, 1)))
    quaternion[..., 3] += np.where(np.linalg.norm(quaternion, axis=2) < 1e-3, 2.0, 0.0)
    return position, quaternion / np.linalg.norm(quaternion, axis=2, keepdims=True)


@given(poses())
def test_decoded_poses_are_near_the_encoded_ones(given):
    position, quaternion = given
    places, turns = decode(encode(position, quaternion, NONE))
    assert places.shape == position.shape and turns.shape == quaternion.shape
    if position.size:
        extent = np.ptp(position.reshape(-1, 3), axis=0).max()
        size = np.abs(position).max()
        np.testing.assert_allclose(places, position, rtol=0, atol=1e-5 * extent + 1e-14 * size)
        assert np.linalg.norm(turns - quaternion, axis=2).max() <= 1.0001e-4


@given(poses())
def test_what_never_changes_is_stored_once(given):
    position, quaternion = (np.repeat(part[:1], 3, axis=0) for part in given)
    code = encode(position, quaternion, NONE)
    assert not code.varying.any()
    assert (decode(code)[0] == decode(code)[0][:1]).all()


@pytest.mark.parametrize("frames", [1, 2])
def test_few_frames_and_no_bodies(frames):
    for count in (0, 2):
        position, quaternion = np.ones((frames, count, 3)), np.tile([0.0, 0, 0, 1], (frames, count, 1))
        places, turns = decode(encode(position, quaternion, NONE))
        np.testing.assert_array_equal(places, position)
        np.testing.assert_allclose(turns, quaternion, atol=1e-12)


def test_free_flight_takes_less_than_a_byte_a_number():
    t = np.linspace(0.0, 1.0, 61)[:, None, None]
    random = np.random.default_rng(0)
    velocity, start = random.normal(size=(200, 3)), random.normal(size=(200, 3))
    position = start + t * velocity - 4.905 * t**2 * [0, 0, 1]
    code = encode(position, np.tile([0.0, 0, 0, 1], (61, 200, 1)), NONE)
    assert len(code.differences) < 0.5 * position.size
    assert code.varying.sum() == 600
