"""Results of runs: trajectories, contacts, diagnosis, files and replays."""

from .diagnosis import Diagnosis
from .reading import load
from .run_data import Impact
from .trajectory import Trajectory

__all__ = ["Diagnosis", "Impact", "Trajectory", "load"]
