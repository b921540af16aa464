"""``python -m tfm_cl`` is ``tfm``."""

import sys

from tfm_cl.cli import main

if __name__ == "__main__":
    sys.exit(main())
