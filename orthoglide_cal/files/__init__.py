"""Files to arrays and back: the only crossing. Everything is checked here, then trusted."""
