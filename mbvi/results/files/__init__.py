"""Files of runs, of mbvi and of other programs."""
