"""Decoders of baked maps, which are copied beside them."""
