"""The layers of a picture, made when they are asked for."""

import numpy as np
import pytest

from tfm_cl.scene.layers import LAYERS, Layers


class Seen:
    """One pixel, through which a third of the light comes."""

    transmittance = np.full((1, 1, 4), 1 / 3, np.float32)
    lights = np.arange(8, dtype=np.float32).reshape(2, 1, 1, 4)
    light_seen = np.array([[[1, 2, 3, 4]]], np.float32)

    def __init__(self):
        self.asked = 0

    @property
    def samples(self):
        self.asked += 1
        return np.full((1, 1), 7, np.uint32)


def test_a_layer_is_made_when_it_is_asked_for_and_once():
    seen = Seen()
    layers = Layers(("samples", "light_transmittance"), seen)
    assert (list(layers), len(layers), seen.asked) == (["samples", "light_transmittance"], 2, 0)
    assert layers["samples"] is layers["samples"]
    assert seen.asked == 1
    assert (layers["samples"].dtype, layers["samples"][0, 0]) == (np.float32, 7)
    assert layers["light_transmittance"][0, 0] == pytest.approx([0.25, 0.5, 0.75])


def test_a_group_is_a_layer_of_each_light():
    layers = Layers(("depth", "lights"), Seen(), ("key", "2"))
    assert list(layers) == ["depth", "light.key", "light.2"]
    assert layers["light.2"].tolist() == [[[4, 5, 6]]]
    assert "lights" not in layers


def test_what_was_not_made_is_not_there():
    layers = Layers(("depth",), Seen())
    assert "normal" in LAYERS
    assert "normal" not in layers
    with pytest.raises(KeyError, match="normal"):
        layers["normal"]
