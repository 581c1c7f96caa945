"""Results of runs: trajectories, contacts, diagnosis, files and replays."""

from .diagnosis.diagnosis import Diagnosis
from .error_estimate import ErrorEstimate
from .files.reading import load
from .run_data import Impact
from .trajectory import Trajectory

__all__ = ["Diagnosis", "ErrorEstimate", "Impact", "Trajectory", "load"]
