"""Orders and errors of every fixed-step scheme on every problem with an exact solution, as a Markdown table."""

from __future__ import annotations

import argparse

import numpy as np

import mbvi
from mbvi import reference
from mbvi_studies.chart.errors import fitted_order, worst_errors

# no step is a dyadic multiple of another
STEPS = 1e-2 * 10.0 ** -np.linspace(0.03, 1.23, 8)

SCHEMES: dict[str, mbvi.schemes.Scheme] = {
    "Paoli": mbvi.Paoli(),
    "MoreauJean(1/2)": mbvi.MoreauJean(),
    "Centered": mbvi.Centered(),
    "Centered, positions projected": mbvi.Centered(project_positions=True),
    "SchatzmanPaoli": mbvi.SchatzmanPaoli(),
}


def row(case: reference.Reference, scheme: mbvi.schemes.Scheme) -> str:
    """Return one line of the table: orders, then errors at the shortest step."""
    found = np.array([worst_errors(case, scheme, h) for h in STEPS])
    orders = " | ".join(f"{fitted_order(STEPS, column):.2f}" for column in found.T)
    return f"{orders} | " + " | ".join(f"{error:.1e}" for error in found[-1])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--restitution", type=float, nargs="*", default=[0.0, 0.5, 1.0], metavar="E")
    print(f"Orders over {len(STEPS)} steps from {STEPS[0]:.1e} to {STEPS[-1]:.1e} s, errors at the shortest.\n")
    print("| problem | e | scheme | order of q | of v | of the graph | error of q | of v | of the graph |")
    print("|---|---|---|---|---|---|---|---|---|")
    for e in parser.parse_args().restitution:
        for case in reference.references(e):
            for name, scheme in SCHEMES.items():
                print(f"| {case.name} | {e:g} | {name} | {row(case, scheme)} |", flush=True)


if __name__ == "__main__":
    main()
