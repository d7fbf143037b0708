"""Inference: hypothesis → fit → belief → decision; what the simulation gets wrong and why."""
