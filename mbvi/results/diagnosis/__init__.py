"""What a run says about itself: the diagnosis, jumps of velocity, energies."""
