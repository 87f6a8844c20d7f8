"""Recordings of a soft body made by another code; imports nothing of this package but itself."""
