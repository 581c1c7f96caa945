"""Time steps and runs from which tests fit the order of a scheme."""

import numpy as np

from mbvi_studies.chart.errors import RUNS

# nowhere dyadic multiples of one another [s]
STEPS = 1e-2 * 10.0 ** -np.linspace(0.03, 1.23, 5)


def runs(case):
    """The number of runs with different phases of the start in a step: impacts feel them."""
    return RUNS if len(case.impacts) else 3
