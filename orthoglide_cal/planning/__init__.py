"""Planning: what to measure, before it is measured."""
