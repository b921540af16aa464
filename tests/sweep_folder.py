"""A sweep's folder without a sweep: rows, images and curves as the tests want them."""

import json

import numpy as np

from tfm_cl.sweep.curves import COUNT
from tfm_cl.sweep.rows import keep_image
from tfm_cl.sweep.run import SweepFolder, SweepRow

RES = (60, 40)
REFERENCE, CONVERGED = "a" * 24, "c" * 24


def key(number):
    return f"{number:024x}"


def row(number, **changes):
    """A row of n = number coefficients; the more, the better."""
    error = 0.5 / number
    figures = {"ssim": 1 - error / 4, "psnr": 20 + 4 * number, "rmse": error}
    values = {
        "volume": "smoke",
        "device": "pretended",
        "version": "1.2.3",
        "basis": "dct",
        "coeffs": number,
        "target": "transmittance",
        "range": "box",
        "fit": "l2",
        "lookup": "interpolate",
        "storage": "f32",
        "density_weighting": 10.0,
        "map_res": 16,
        "map_steps": 20,
        "view_steps": 30,
        "width": RES[0],
        "height": RES[1],
        **figures,
        **{
            f"{prefix}_{name}": v
            for prefix in ("lit", "converged", "converged_lit")
            for name, v in figures.items()
        },
        "flip": error / 2,
        "t_error": error / 10,
        "seconds_light_pass": 0.01,
        "seconds_view_pass": 0.02 + number / 1e3,
        "seconds_reference": 0.3,
        "map_bytes": 4 * number * 256,
        "bytes_per_texel": 4.0 * number + 8,
        "reference": REFERENCE,
        "converged": CONVERGED,
        "key": key(number),
    }
    return SweepRow(**(values | changes))


def picture(brightness, res=RES):
    """A lit rectangle in the dark [H, W, 4], brighter to the right."""
    width, height = res
    image = np.zeros((height, width, 4), np.float32)
    square = image[height // 4 : -(height // 4), width // 4 : -(width // 4)]
    square[:] = np.float32(brightness) * np.linspace(0.2, 1.0, square.shape[1], dtype=np.float32)[:, None]
    square[..., 3] = 0.9
    return image


def make_folder(out, rows, images=None, curves=True):
    """Fill a folder; the reference is white, the converged one a little darker, rows brighter the better."""
    folder = SweepFolder(out)
    for item in rows:
        folder.append(item)
        res = item.width, item.height
        keep_image(out, item.key, picture(1 - 0.5 / item.coeffs, res))
        keep_image(out, item.reference, picture(1.0, res))
        if item.converged:
            keep_image(out, item.converged, picture(0.98, res))
        if curves:
            keep_curves(out, item.reference, [row for row in rows if row.reference == item.reference])
    for name, image in (images or {}).items():
        keep_image(out, name, image)
    folder.close()
    return out


def keep_curves(out, reference, rows):
    distance = np.linspace(2, 5, COUNT)
    exact = np.exp(-np.clip(distance - 3, 0, None))
    content = {
        "volume": rows[0].volume,
        "light": 0,
        "u": 0.25,
        "v": 0.75,
        "distance": distance.tolist(),
        "exact": exact.tolist(),
        "curves": [
            {
                "label": f"{row.basis} n={row.coeffs}",
                "key": row.key,
                "values": (exact + 0.1 / row.coeffs).tolist(),
            }
            for row in rows
        ],
    }
    (out / "curves").mkdir(exist_ok=True)
    (out / "curves" / f"{reference}.json").write_text(json.dumps(content), encoding="utf-8")
