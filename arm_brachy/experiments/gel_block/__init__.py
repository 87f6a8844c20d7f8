"""Another laboratory: a block of gel on a bench, pushed by square pads, recorded as CSV files."""
