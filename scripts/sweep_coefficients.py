#!/usr/bin/env python3
"""Render scenes with maps of 2, 4, 8, 16 … coefficients and measure each against the dual march.

The same as ``tfm sweep``; see ``scripts/sweep_coefficients.py --help``.
"""

import sys

from tfm_cl.cli import main

if __name__ == "__main__":
    sys.exit(main(["sweep", *sys.argv[1:]]))
