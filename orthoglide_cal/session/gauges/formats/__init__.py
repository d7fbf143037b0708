"""One small file per serial gauge format; each defines `FORMAT` and is found by itself."""
