"""The paper's tables, recomputed and held beside what was printed."""
