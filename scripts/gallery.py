"""Render the README's pictures from the sample scenes: ``python scripts/gallery.py``."""

import sys
from pathlib import Path

from tfm_cl.cli import main

VOLUMES = Path(__file__).resolve().parents[1] / "volumes"
SIZES = {
    "sky": "1280x720",
    "cumulus": "640x360",
    "plume": "480x600",
    "figure": "480x480",
    "fire": "1280x720",
    "inks": "1280x720",
    "smoke_and_solids": "640x480",
    "shafts": "1280x720",
    "two_clouds": "640x360",
    "lamps": "640x360",
    "projector": "480x480",
    "ambient": "640x360",
    "foggy_room": "1280x720",
    "brown_and_white": "1280x720",
    "particles": "1280x720",
    "spirals": "640x360",
    "mixed": "640x360",
    "hair": "1280x720",
    "tree": "640x360",
}


def render_all() -> int:
    """Render each sample scene; returns the first exit code that is not 0."""
    for name, size in SIZES.items():
        out = VOLUMES / "gallery" / f"{name}.png"
        scene = str(VOLUMES / f"{name}.toml")
        code = main(["render", scene, "-o", str(out), "--res", size, "--samples", "16"])
        if code:
            return code
        print(out)
    return 0


if __name__ == "__main__":
    sys.exit(render_all())
