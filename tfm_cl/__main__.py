"""``python -m tfm_cl`` is ``tfm``."""

import sys

from tfm_cl.cli import program

if __name__ == "__main__":
    sys.exit(program())
