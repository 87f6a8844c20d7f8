"""Another laboratory: a half-cylinder of gel under three round pads, recorded as CSV files."""
