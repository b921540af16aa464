"""What is rendered: plain data and its geometry in float64."""
