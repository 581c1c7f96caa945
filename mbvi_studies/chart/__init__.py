"""Work-precision charts: errors of runs against exact solutions, their CPU times, and the picture."""

from .errors import Errors, errors, fitted_order, path_errors, sampled_errors, worst_errors
from .graphs import graph_distance
from .records import Record, read_csv, write_csv
from .sweep import Case, sweep

__all__ = [
    "Case",
    "Errors",
    "Record",
    "errors",
    "fitted_order",
    "graph_distance",
    "path_errors",
    "read_csv",
    "sampled_errors",
    "sweep",
    "worst_errors",
    "write_csv",
]
