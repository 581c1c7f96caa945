"""What several test modules share; programs that tests start import from here too."""
