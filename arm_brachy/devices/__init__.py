"""Actuators, trackers and force sensors; see README.md."""
