"""Rays among solids."""
