"""The integrator's: monitor, conformance, scenarios, and the interface page."""
