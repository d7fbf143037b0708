"""The model of readings: plan, rails, causes, the forward model; tool error and compensation."""
