"""Frames of a shot: which there are, what each is of, and how they are rendered."""
