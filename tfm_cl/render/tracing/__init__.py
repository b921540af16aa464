"""Ray tracing of solids."""
