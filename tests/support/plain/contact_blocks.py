"""Plain forms of the kernels that pack sparse rows of contacts and sweep over them."""

import numpy as np

from mbvi.projection.coulomb.one_contact import solve_contact
from support.contact_block_arguments import matrix


def pack_contacts_plain(data, columns, starts, n, bound, blocks, own_columns, own_starts, local):
    U = np.zeros((len(local), 3, n))
    own_starts[0] = 0
    for a in range(len(local)):
        here = slice(starts[3 * a], starts[3 * a + 3])
        for row in range(3):
            for k in range(starts[3 * a + row], starts[3 * a + row + 1]):
                U[a, row, columns[k]] += data[k]
        used = list(dict.fromkeys(columns[here].tolist()))
        G, local[a] = U[a] @ U[a].T, [0, 0, 1, 1, 1, 0, 0]
        turn = np.zeros((3, 3))
        if bound[a] >= 0:
            G[0, 0] = max(G[1, 1], G[2, 2])
        if G[0, 0] > 0.0:
            k = G[1:, 0] / G[0, 0]
            A = G[1:, 1:] / G[0, 0] - np.outer(k, k)
            mean, spread = 0.5 * np.trace(A), np.hypot(0.5 * (A[0, 0] - A[1, 1]), A[0, 1])
            x, y = 1.0, 0.0
            if spread > 1e-13 * mean:
                angle = 0.5 * np.arctan2(A[0, 1], 0.5 * (A[0, 0] - A[1, 1]))
                x, y = np.cos(angle), np.sin(angle)
                # which of the two senses of an axis is taken is a convention
                if (y if A[0, 0] < A[1, 1] else x) * (spread if A[0, 0] >= A[1, 1] else 1.0) < 0.0:
                    x, y = -x, -y
            turn = np.array([[1.0, 0.0, 0.0], [0.0, x, y], [0.0, -y, x]]) / np.sqrt(G[0, 0])
            first = max(mean + spread, 1e-14)
            local[a] = (
                *(turn[1:, 1:] @ k * np.sqrt(G[0, 0])),
                first,
                max(mean - spread, 1e-14 * first),
                x,
                y,
                turn[0, 0],
            )
        if bound[a] >= 0 and local[a, 3] <= 1e-13 * local[a, 2]:
            local[a, 3] = -local[a, 2]
        end = own_starts[a] + len(used)
        own_columns[own_starts[a] : end] = used
        blocks[3 * own_starts[a] : 3 * end] = (turn @ U[a][:, used]).T.ravel()
        own_starts[a + 1] = end


def sweep_blocks_plain(blocks, columns, starts, local, b, mu, bound, weight, point, last, z, p):
    A = matrix(blocks, columns, starts, len(z))
    before = p.copy()
    uphill = 0.0
    for a in range(len(mu)):
        rows = A[3 * a : 3 * a + 3]
        here, old, new = slice(3 * a, 3 * a + 3), p[3 * a : 3 * a + 3].copy(), np.empty(3)
        G = np.ascontiguousarray(rows @ rows.T)
        others = b[here] + rows @ z - G @ (old + weight * point[here])
        if bound[a] >= 0:
            G[0, 0], others[0] = 1.0 / (1.0 + weight), -p[3 * bound[a]]
        if G[0, 0] > 0.0:
            solve_contact((1.0 + weight) * G, 0, *others, mu[a], new)
        else:
            new[:] = 0.0
            new[0] = max(-(others[0] - old[0] - weight * point[3 * a]) / (1.0 + weight), 0.0)
        p[here] = new
        z += rows.T @ (new - old)
        uphill -= (new - old) @ (new - last[here])
    return float(np.abs(p - before).max()), uphill
