"""The paper's tables, recomputed, next to what was printed."""
