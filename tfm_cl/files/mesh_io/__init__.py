"""Reading meshes, bounded and without trust."""
