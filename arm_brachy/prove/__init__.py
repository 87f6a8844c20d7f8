"""The sealed blind trial of the diagnosis: recordings with a hidden effect, answers, score."""
