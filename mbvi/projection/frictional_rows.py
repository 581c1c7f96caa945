"""What the projection needs of rows with tangents."""

from __future__ import annotations

from typing import Protocol

from scipy.sparse import csr_array

from .metric import Array


class FrictionalRows(Protocol):
    """What the projection needs of rows with tangents, which `constraints.Rows` has."""

    @property
    def constraint(self) -> Array:
        """The constraint of each row, shape (k,)."""

    @property
    def jacobian(self) -> Array | csr_array:
        """Gradients, shape (k, nv)."""

    @property
    def restitution(self) -> Array:
        """Restitution, shape (k,)."""

    @property
    def rate(self) -> Array | None:
        """Rates of gaps at v = 0, shape (k,)."""

    @property
    def tangents(self) -> TangentRows | None:
        """Their tangents."""


class TangentRows(Protocol):
    """What it needs of tangents, which `constraints.Tangents` has."""

    @property
    def friction(self) -> Array:
        """Coefficients, shape (k,)."""

    @property
    def jacobian(self) -> Array | csr_array:
        """Gradients, shape (2 k, nv)."""

    @property
    def rate(self) -> Array | None:
        """Rates at v = 0, shape (2 k,)."""

    @property
    def resistance(self) -> Array | None:
        """Lengths of torsional and rolling friction, shape (k, 2)."""

    @property
    def bound(self) -> Array | None:
        """Which contact bounds each; see `coulomb_law`. None where each has a normal of its own."""
