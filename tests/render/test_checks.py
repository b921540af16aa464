"""What is no scene, crop, map… is told in a line, before anything is rendered."""

import numpy as np
import pytest
from scenes import make_scene

from tfm_cl.errors import SceneError
from tfm_cl.render.checks import checked_crop, checked_moment

WRONG = [
    ({"crop": "a"}, "crop = 'a': should be four whole numbers"),
    ({"crop": (0, 0, 1.5, 2)}, r"crop = \(0, 0, 1.5, 2\): should be four whole numbers"),
    ({"aovs": 3}, "aovs = 3: should be a list of names"),
    ({"aovs": "lights"}, r"aovs = 'lights': should be a list of names of layers, as \['lights'\]"),
    ({"aovs": ["light"]}, "image.aov = .*unknown aov 'light'"),
    ({"samples": None}, "image.samples = None: should be 1, 4"),
    ({"progress": 3}, "progress = 3: should be a function"),
    ({"method": 3}, "method '3' is unknown"),
]


@pytest.mark.parametrize(("asked", "said"), WRONG, ids=str)
@pytest.mark.parametrize("blurred", [False, True])
def test_arguments_of_other_types(renderer, asked, said, blurred):
    render = renderer.render_blurred if blurred else renderer.render
    with pytest.raises(SceneError, match=f"^{said}") as error:
        render(make_scene(), **asked)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("what", ["render", "render_blurred", "build_maps"])
@pytest.mark.parametrize("scene", [None, "scene.toml"])
def test_what_is_no_scene(renderer, what, scene):
    with pytest.raises(SceneError, match=r"^scene = .*: should be a Scene, as Scene.load returns"):
        getattr(renderer, what)(scene)


@pytest.mark.parametrize("asked", [{"maps": 3}, {"maps": [1]}, {"deep": 0.1, "deep_colour": "x"}], ids=str)
def test_arguments_of_sharp_pictures(renderer, asked):
    with pytest.raises(SceneError, match=r"^(maps = .*: should be what build_maps|image.deep_colour = 'x')"):
        renderer.render(make_scene(), **asked)


def test_moments_are_scenes():
    scene = make_scene()
    assert checked_moment(lambda _: scene)(0.5) is scene
    with pytest.raises(SceneError, match="scene = 3"):
        checked_moment(lambda _: 3)(0.5)


def test_whole_numbers_of_any_kind_crop():
    assert checked_crop(np.array([1, 2, 3, 4]), (8, 8)) == (1, 2, 3, 4)
