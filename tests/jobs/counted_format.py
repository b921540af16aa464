"""A plugin: images ``.counted``, which are written slowly, and of which is written down who wrote which.

Frames are known by their cameras.
"""

import os
import time
import zlib

import numpy as np

import tfm_cl as tfm

HOLDS_LAYERS = False


def write(path, image, _options):
    frame = zlib.crc32(np.asarray(image.metadata["worldToCamera"], np.float32).tobytes())
    with path.with_name(f"{os.getpid()}.log").open("a", encoding="utf-8") as log:
        print("began", frame, file=log, flush=True)
        time.sleep(1.0)
        with path.open("wb") as stream:
            np.save(stream, image.rgba)
        print("ended", frame, file=log, flush=True)


tfm.register_image_format(".counted", __name__)
