"""`mbvi chart gradients`: derivatives through an impact, as a picture and a table."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from ..pictures import check_pictures

# the name of the picture on the command line
GRADIENTS = "gradients"
_COUNT = 13


def chart_gradients(out: Path, count: int = _COUNT) -> None:
    """Measure and draw the derivative of an elastic bounce, by mbvi and by MuJoCo if that is installed.

    Parameters
    ----------
    out : Path
        Where to write, without suffix.
    count : int
        Number of steps.
    """
    from ..chart.gradient_picture import draw_gradients, gradient_table
    from ..chart.gradients import GradientRecord, measure_ours, steps_of
    from ..chart.records import write_table

    check_pictures(out.parent)
    steps = steps_of(count)
    records = measure_ours(steps)
    if find_spec("mujoco") is None:
        print("MuJoCo is not installed: pip install mujoco")
    else:
        from ..engines.gradient_in_mujoco import measure

        records += measure(steps)
    write_table(records, out.with_suffix(".csv"), GradientRecord)
    figure = draw_gradients(records)
    for suffix in (".png", ".svg"):
        figure.savefig(out.with_suffix(suffix), dpi=110)
    print(gradient_table(records))
    for line, setting in dict.fromkeys((r.line, r.setting) for r in records if r.setting):
        print(f"{line}: {setting}")
    print(f"picture      {out.with_suffix('.png')}, {out.with_suffix('.svg')}")
    print(f"table        {out.with_suffix('.csv')}")
