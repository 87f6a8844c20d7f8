"""Recordings of a soft body made by another code; imports nothing of this package but itself."""

import logging

# It tells of every copy of an array that it makes, on the terminal of whoever runs a trial.
logging.getLogger('skfem').setLevel(logging.ERROR)
