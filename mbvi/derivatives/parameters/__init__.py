"""The parameters by which a run is differentiated."""
