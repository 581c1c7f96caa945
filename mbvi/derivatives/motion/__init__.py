"""The linearised smooth motion and law of impacts."""
