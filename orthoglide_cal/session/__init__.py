"""The guided measurement: steps, forecast and live checks of readings, journal, gauges."""
