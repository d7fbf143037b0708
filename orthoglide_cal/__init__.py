"""orthocal: joint-offset calibration and diagnosis of Orthoglide-type parallel machines."""

__version__ = "0.1.0"
