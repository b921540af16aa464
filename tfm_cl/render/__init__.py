"""From a scene to a picture: the passes in their order, and what they need from the host."""
