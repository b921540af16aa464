"""The sweep: quality against coefficients, and its report."""
