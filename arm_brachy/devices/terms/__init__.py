"""Faults and lags of devices, one file each."""
