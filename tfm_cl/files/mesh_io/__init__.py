"""Reads mesh files with bounded memory; nothing that a file declares is trusted."""
