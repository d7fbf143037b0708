"""Gauges: what they send and people type, serial lines, and a simulated machine."""
