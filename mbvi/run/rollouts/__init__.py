"""Many runs of one problem from given states."""
