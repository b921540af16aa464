"""A picture and its layers as one piece of HTML, for notebooks: without script, of limited size."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tfm_cl.files.image_io.inline import encoded
from tfm_cl.render.shown import MEANING, PICTURE, shown_layer
from tfm_cl.scene.layers import layer_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

    from tfm_cl.render.shown import Rendered, Shown
    from tfm_cl.scene.layers import Holds

LONGEST_SIDE = 960
"""Pixels of a picture; larger ones are made smaller, by a whole number."""
MOST_LAYERS = 16
"""With the picture; others are only counted."""
MOST_BYTES = 2 << 20
"""Of all pictures together: notebooks are kept, and sent."""

_STYLE = """
.tfm-layers { font: 13px/1.5 system-ui, sans-serif; }
.tfm-layers label { display: inline-block; margin: 0 1em 0 0; cursor: pointer; }
.tfm-layers input { margin: 0 0.35em 0 0; vertical-align: -1px; }
.tfm-layers figure { margin: 6px 0 0; }
.tfm-layers img { display: block; max-width: 100%; height: auto; background: #000; }
.tfm-layers figcaption { max-width: 60em; opacity: 0.75; }
"""


def html_of(result: Rendered, about: str) -> str:
    """Return a picture, and a row of its layers to choose from.

    Where a page shows no styles, all of them lie below each other.

    Parameters
    ----------
    result
        What was rendered.
    about
        A line that tells of it.
    """
    layers = list(result.aovs)[: MOST_LAYERS - 1]
    smaller = _smaller(result, layers)
    labels, figures, room = list[str](), list[str](), MOST_BYTES
    for name in (PICTURE, *layers):
        shown = shown_layer(smaller, name)
        mime, content = encoded(shown.pixels, "low")
        if len(content) > room:
            break
        room -= len(content)
        chosen = "" if labels else " checked"
        labels.append(f'<label><input type="radio" name="layer"{chosen}>{escape(name)}</label>')
        source = f"data:{mime};base64,{base64.b64encode(content).decode('ascii')}"
        caption = escape(f"{name}: {_meaning(name)}{_scale(shown)}")
        figures.append(
            f'<figure><img src="{source}" alt="{escape(name)}"><figcaption>{caption}</figcaption></figure>'
        )
    left_out = 1 + len(result.aovs) - len(labels)
    more = f" {left_out} more layers are in result.aovs." if left_out else ""
    return (
        f'<form class="tfm-layers"><style>{_STYLE}{_chosen(len(labels))}</style>'
        f'<div role="radiogroup" aria-label="layer">{"".join(labels)}</div>'
        f"{''.join(figures)}<div>{escape(about)}{more}</div></form>"
    )


def _chosen(count: int) -> str:
    """Return the rules by which only the chosen one of so many pictures shows."""
    chosen = ", ".join(
        f".tfm-layers:has(label:nth-of-type({n}) :checked) figure:nth-of-type({n})"
        for n in range(1, count + 1)
    )
    rules = f".tfm-layers figure {{ display: none; }} {chosen} {{ display: block; }}"
    return f"@supports selector(:has(a)) {{ {rules} }}"


def _meaning(name: str) -> str:
    return MEANING if name == PICTURE else layer_of(name).meaning


def _scale(shown: Shown) -> str:
    if shown.range is None:
        return ""
    low, high = shown.range
    return f" ({shown.colours}, {low:.3g} to {high:.3g})"


class _Smaller(NamedTuple):
    """A result of as many pixels as are shown."""

    image: NDArray[np.float32]
    aovs: Mapping[str, NDArray[np.float32]]
    crop: tuple[int, int, int, int]


def _smaller(result: Rendered, names: Iterable[str]) -> _Smaller:
    layers = {name: _reduced(result.aovs[name], layer_of(name).holds) for name in names}
    return _Smaller(_reduced(result.image, "light"), layers, result.crop)


def _reduced(values: NDArray[np.float32], holds: Holds) -> NDArray[np.float32]:
    """Take the mean of colours over whole blocks of pixels; of other numbers, whose 0 is none, one."""
    height, width = values.shape[:2]
    factor = -(-max(height, width) // LONGEST_SIDE)
    if factor == 1:
        return values
    down, across = min(factor, height), min(factor, width)
    rows, columns = height // down, width // across
    blocks = values[: rows * down, : columns * across].reshape(rows, down, columns, across, -1)
    is_colour = holds in ("light", "share")
    found = blocks.mean(axis=(1, 3)) if is_colour else blocks[:, down // 2, :, across // 2]
    return np.asarray(found.reshape(rows, columns, *values.shape[2:]), np.float32)
