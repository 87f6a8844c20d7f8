"""Faults put into another laboratory's recordings of a dome, or into its scene file."""
