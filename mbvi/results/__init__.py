"""Results of runs: trajectories, contacts, diagnosis, files and replays."""

from .diagnosis import Diagnosis
from .hdf5 import load
from .trajectory import Impact, Trajectory

__all__ = ["Diagnosis", "Impact", "Trajectory", "load"]
