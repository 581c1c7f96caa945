"""States, impacts and contacts of a run, recorded step by step."""
