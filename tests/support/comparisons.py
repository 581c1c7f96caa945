"""Whether two runs are the same."""

import numpy as np


def same_states(part, whole):
    """Whether one run is the beginning of another."""
    n, m = len(part.t), len(part.impacts)
    for name in ("t", "q", "v", "residual"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[:n])
    assert [(i.time, i.constraints) for i in part.impacts] == [(i.time, i.constraints) for i in whole.impacts[:m]]
