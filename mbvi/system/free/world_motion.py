"""Kernels of the motion of single free bodies in the world: centres of mass, their velocities, and spins."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..system import Array
from .free_body_table import FreeBodyTable
from .turning import write_rotation


@kernel("void(FreeBodyTable, i8, f8[::1], f8[::1], f8, f8[::1])")
def add_spin(bodies: FreeBodyTable, b: int, q: Array, v: Array, factor: float, spin: Array) -> None:
    """Add a multiple of the angular momentum of body b about its centre, in the world, to `spin`, shape (3,)."""
    if not bodies.turns[b]:
        return
    C, j, inertia = np.empty((3, 3)), bodies.v[b] + 3, bodies.inertia[b]
    write_rotation(q, bodies.q[b] + 3, C)
    for c in range(3):
        own = factor * (inertia[c, 0] * v[j] + inertia[c, 1] * v[j + 1] + inertia[c, 2] * v[j + 2])
        for d in range(3):
            spin[d] += C[c, d] * own


@kernel("void(FreeBodyTable, i8, f8[::1], f8[::1], f8[::1])")
def set_spin(bodies: FreeBodyTable, b: int, q: Array, spin: Array, v: Array) -> None:
    """Write the angular velocity of body b that has a given angular momentum in the world, shape (3,)."""
    C, j, own = np.empty((3, 3)), bodies.v[b] + 3, np.zeros(3)
    write_rotation(q, bodies.q[b] + 3, C)
    for c in range(3):
        for d in range(3):
            own[c] += C[c, d] * spin[d]
    for c in range(3):
        v[j + c] = (
            bodies.inverse[b, c, 0] * own[0] + bodies.inverse[b, c, 1] * own[1] + bodies.inverse[b, c, 2] * own[2]
        )


@kernel("void(FreeBodyTable, i8, f8[::1], f8[::1])")
def write_centre(bodies: FreeBodyTable, b: int, q: Array, centre: Array) -> None:
    """Write the centre of mass of body b, shape (3,)."""
    i = bodies.q[b]
    for c in range(3):
        centre[c] = q[i + c]
    if bodies.turning[b]:
        C, arm = np.empty((3, 3)), bodies.centre[b]
        write_rotation(q, i + 3, C)
        for c in range(3):
            centre[c] += C[0, c] * arm[0] + C[1, c] * arm[1] + C[2, c] * arm[2]


@kernel("void(FreeBodyTable, i8, f8[::1], f8[::1], f8, f8[::1])")
def add_velocity(bodies: FreeBodyTable, b: int, q: Array, v: Array, factor: float, velocity: Array) -> None:
    """Add a multiple of the velocity of the centre of mass of body b in the world to `velocity`, shape (3,)."""
    j = bodies.v[b]
    if not bodies.turning[b]:
        for c in range(3):
            velocity[c] += factor * v[j + c]
        return
    C, arm = np.empty((3, 3)), bodies.centre[b]
    write_rotation(q, bodies.q[b] + 3, C)
    for c in range(3):
        k, i = (c + 1) % 3, (c + 2) % 3
        own = factor * (v[j + c] + v[j + 3 + k] * arm[i] - v[j + 3 + i] * arm[k])
        for d in range(3):
            velocity[d] += C[c, d] * own


@kernel("void(FreeBodyTable, i8, f8[::1], f8[::1], f8[::1])")
def set_velocity(bodies: FreeBodyTable, b: int, q: Array, velocity: Array, v: Array) -> None:
    """Write the linear velocity of body b whose centre of mass has a given one, shape (3,), at its angular velocity."""
    j = bodies.v[b]
    if not bodies.turning[b]:
        for c in range(3):
            v[j + c] = velocity[c]
        return
    C, arm = np.empty((3, 3)), bodies.centre[b]
    write_rotation(q, bodies.q[b] + 3, C)
    for c in range(3):
        k, i = (c + 1) % 3, (c + 2) % 3
        v[j + c] = C[c, 0] * velocity[0] + C[c, 1] * velocity[1] + C[c, 2] * velocity[2]
        v[j + c] -= v[j + 3 + k] * arm[i] - v[j + 3 + i] * arm[k]
