"""What is decided before a map is built: functions that serve several frames."""

import tomllib

import numpy as np
from scenes import make_scene, turned
from tolerances import LEARNT_TOGETHER

import tfm_cl as tfm
from tfm_cl.maps.bases.curves import CELLS, Curves
from tfm_cl.maps.bases.given import functions_in
from tfm_cl.scene.scene_file_writer import to_toml

RANGE = tfm.MapSettings(res=24, steps=24)
"""With the basis that learns."""


def test_functions_for_several_frames(renderer):
    still = make_scene(map=RANGE)
    scenes = [still, still.replace(volume=still.volume.transformed(turned(0, (0, 1, 0), offset=(0, 0.1, 0))))]
    functions = renderer.functions_for(scenes)
    given = tfm.MapSettings.from_table(tomllib.loads(to_toml({"map": {"functions": functions}}))["map"])
    assert given.functions == functions
    for scene in scenes:
        shared = scene.replace(map=RANGE.replace(functions=given.functions))
        (built,) = renderer.build_maps(shared)
        assert built.plan.modes.tolist() == functions_in(functions).tolist()
        own, found = (renderer.render(one).image[..., :3] for one in (scene, shared))
        assert np.sqrt(np.mean((found - own) ** 2)) < LEARNT_TOGETHER * own.mean()
        assert renderer.functions_for([shared]) is None


def test_bases_that_learn_nothing(renderer):
    assert renderer.functions_for([make_scene(map=RANGE.replace(basis="dct"))]) is None
    assert renderer.functions_for([]) is None


def test_rays_together():
    thin, deep = (np.full((count, CELLS + 1), float(count)) for count in (3, 9))
    found = Curves.together([Curves(thin, 1.0), Curves(deep, 2.0)], 6)
    assert found.optical_depth[:, 0].tolist() == [3, 3, 9, 9, 9, 9]
    assert found.extinction[:, 0].tolist() == [1, 1, 2, 2, 2, 2]
    assert found.visibility.shape == (6, CELLS)
