"""Time steps at which tests fit the order of a scheme."""

import numpy as np

# nowhere dyadic multiples of one another [s]
STEPS = 1e-2 * 10.0 ** -np.linspace(0.03, 1.23, 5)
