"""What every gauge reads: plan, rails, causes, the forward model; tool error and compensation."""
