"""The layers of a picture, made when they are asked for."""

import numpy as np
import pytest

from tfm_cl.scene.layers import GROUPS, LAYERS, Layers, layer_of


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
    layers = Layers(("depth", "lights"), Seen(), {"lights": ("key", "2")})
    assert list(layers) == ["depth", "light.key", "light.2"]
    assert layers["light.2"].tolist() == [[[4, 5, 6]]]
    assert "lights" not in layers


def test_orders_are_differences_of_their_sums():
    """Of two later orders, which show 1 and 2; the first has what is left."""

    class Scattered(Seen):
        radiance, emission, ambient, later = (np.full((1, 1, 4), n, np.float32) for n in (9, 1, 2, 3.5))
        up_to_orders = np.array([0.5, 1.5], np.float32)[:, None, None, None] * np.ones(4, np.float32)

    layers = Layers(("orders",), Scattered(), {"orders": ("1", "2", "3")})
    assert list(layers) == ["orders", "orders.1", "orders.2", "orders.3"]
    assert [float(layers[name][0, 0, 0]) for name in layers] == [3.5, 3, 1, 2]


def test_what_was_not_made_is_not_there():
    layers = Layers(("depth",), Seen())
    assert "normal" in LAYERS
    assert "normal" not in layers
    with pytest.raises(KeyError, match="normal"):
        layers["normal"]


def test_what_layers_hold_says_how_many_channels_they_have():
    for layer in (*LAYERS.values(), *(group.layer(0) for group in GROUPS.values())):
        assert layer.channels == (1 if layer.holds in ("number", "error") else 3)
    assert layer_of("depth") is LAYERS["depth"]
    assert layer_of("light.key").holds == "light"
    with pytest.raises(KeyError):
        layer_of("detph")
