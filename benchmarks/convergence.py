"""Fitted orders and errors of Paoli's scheme on every problem with an exact solution, as a table in Markdown."""

from __future__ import annotations

import argparse

import numpy as np

import mbvi
from mbvi import reference
from mbvi.work_precision import errors, fitted_order

# nowhere dyadic multiples of one another; of neighbouring steps the worst counts, for an impact's phase scatters errors
STEPS = 1e-2 * 10.0 ** -np.linspace(0.03, 1.4, 8)
NEIGHBOURS = np.linspace(1.0, 0.8, 6)


def row(case: reference.Reference, scheme: mbvi.Paoli) -> str:
    """Return one line of the table: orders, then errors at the least step."""
    worst = np.array(
        [
            np.max(
                [
                    errors(mbvi.simulate(case.problem, scheme, step=h * near, duration=case.duration), case)
                    for near in NEIGHBOURS
                ],
                axis=0,
            )
            for h in STEPS
        ]
    )
    orders = " | ".join(f"{fitted_order(STEPS, column):.2f}" for column in worst.T)
    return f"{orders} | " + " | ".join(f"{error:.1e}" for error in worst[-1])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--restitution", type=float, nargs="*", default=[0.0, 0.5, 1.0], metavar="E")
    print(f"Orders over {len(STEPS)} steps from {STEPS[0]:.1e} to {STEPS[-1]:.1e} s, errors at the least.\n")
    print("| problem | e | order of q | of v | of the graph | error of q | of v | of the graph |")
    print("|---|---|---|---|---|---|---|---|")
    for e in parser.parse_args().restitution:
        for case in reference.references(e):
            print(f"| {case.name} | {e:g} | {row(case, mbvi.Paoli())} |", flush=True)


if __name__ == "__main__":
    main()
