"""Measurements: what is fast, what it costs in accuracy, on the machine at hand."""
