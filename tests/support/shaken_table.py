"""A constraint of a user that moves: a table that is shaken."""

import dataclasses

import numpy as np


@dataclasses.dataclass
class Table:
    """q >= a sin(w t)."""

    a: float
    w: float

    def gap(self, t, q):
        return q[:1] - self.a * np.sin(self.w * t)

    def gradient(self, t, q):
        return np.ones((1, 1))

    def rate(self, t, q):
        return np.array([-self.a * self.w * np.cos(self.w * t)])
