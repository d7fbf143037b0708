"""The guided measurement: steps, live checks, journal, gauges; no numerics of its own."""
