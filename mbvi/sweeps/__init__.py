"""Many runs of one question: points, runs on a Dask cluster, the folder of a study, pictures and replays of it."""

from .outputs.picture import plot_sweep
from .outputs.replay import replay
from .sweep import sweep

__all__ = ["plot_sweep", "replay", "sweep"]
