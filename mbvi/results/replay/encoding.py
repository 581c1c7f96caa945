"""Poses of a replay as few bytes: whole numbers of 16 bits, second differences in time, deflated."""

from __future__ import annotations

import base64
import zlib
from typing import NamedTuple

import numpy as np

Array = np.ndarray

# positions have 65535 steps along the longest side of the motion; entries of a quaternion are multiples of this
TURN_STEP = 1e-4
_LEVELS = 65535
# higher levels of zlib take twice the time for 1 % of the bytes
_LEVEL = 4


class Encoded(NamedTuple):
    """Positions and quaternions as bytes.

    `origin`, shape (3,), and `step` scale positions [m]. `first`, shape (7 n,), holds the first frame, and `varying`,
    shape (7 n,), which numbers ever change; `differences` are those of the frames after the first.
    """

    frames: int
    origin: Array
    step: float
    first: Array
    varying: Array
    differences: bytes


def quantised(position: Array, quaternion: Array, origin: Array, step: float) -> Array:
    """Return positions (..., n, 3) and quaternions (..., n, 4) as whole numbers modulo 2^16, shape (..., 7 n)."""
    places = np.rint((position - origin) / step).astype(np.int32)
    turns = np.rint(quaternion / TURN_STEP).astype(np.int32)
    return (
        np.concatenate([places, turns], axis=-1).astype(np.uint16).reshape(*position.shape[:-2], 7 * position.shape[-2])
    )


def encode(position: Array, quaternion: Array, beside: Array) -> Encoded:
    """Encode poses at the frames.

    Parameters
    ----------
    position, quaternion : ndarray, shape (frames, n, 3) and (frames, n, 4)
        Positions [m] and rotations (x, y, z, w), both finite.
    beside : ndarray, shape (k, 3)
        Other positions that `quantised` shall know by the same origin and step [m].

    Returns
    -------
    Encoded
        Decoded, a position is wrong by 1e-5 of the longest side of the motion at most, and a quaternion by 1e-4.
    """
    flat = np.concatenate([position.reshape(-1, 3), beside])
    origin = flat.min(axis=0, initial=np.inf) if len(flat) else np.zeros(3)
    side = float((flat.max(axis=0) - origin).max()) if len(flat) else 0.0
    # where nothing moves any step does; a step that is lost beside the coordinates would divide by zero
    step = max(side / _LEVELS, float(np.abs(flat).max(initial=0.0)) * 1e-15, 1e-300)
    numbers = quantised(position, quaternion, origin, step)
    varying = (numbers[1:] != numbers[:1]).any(axis=0)
    change = np.diff(numbers[:, varying], axis=0)
    change[1:] = np.diff(change, axis=0)
    # low bytes apart from high ones, which are nearly all alike
    halves = np.stack([change & 255, change >> 8]).astype(np.uint8)
    return Encoded(len(position), origin, step, numbers[0], varying, zlib.compress(halves.tobytes(), _LEVEL))


def decode(encoded: Encoded) -> tuple[Array, Array]:
    """Return positions (frames, n, 3) and quaternions (frames, n, 4), as the page computes them."""
    count = int(encoded.varying.sum())
    low, high = np.frombuffer(zlib.decompress(encoded.differences), np.uint8).reshape(2, encoded.frames - 1, count)
    change = np.cumsum(low + (high.astype(np.uint16) << 8), axis=0, dtype=np.uint16)
    numbers = np.repeat(encoded.first[None], encoded.frames, axis=0)
    numbers[1:, encoded.varying] += np.cumsum(change, axis=0, dtype=np.uint16)
    parts = numbers.reshape(encoded.frames, -1, 7)
    return encoded.origin + encoded.step * parts[..., :3], TURN_STEP * parts[..., 3:].view(np.int16)


def packed(values: Array) -> str:
    """Return the bytes of an array, deflated, as text."""
    return text_of(zlib.compress(np.ascontiguousarray(values).tobytes(), _LEVEL))


def text_of(data: bytes) -> str:
    """Return bytes as text that a page can hold."""
    return base64.b64encode(data).decode()
