"""Media by name."""

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.scene.medium import Medium
from tfm_cl.scene.optical_depth import density_scale_for
from tfm_cl.scene.presets import PRESETS
from tfm_cl.scene.scene_file import SceneFile


def read(folder, text, *overrides):
    """Read a scene file with one voxel of density."""
    np.save(folder / "a.npy", np.pad(np.ones((1, 1, 1), np.float32), 1))
    path = folder / "a.toml"
    path.write_text(text)
    return SceneFile.read(path, overrides)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_extinguishes_1_at_density_1(name):
    medium = Medium(preset=name)
    assert medium.sigma_t == pytest.approx(np.ones(3))
    assert medium.phase.mean_cosine > 0.2  # none of these scatters evenly
    assert Medium.from_table({k: v for k, v in medium.to_dict().items() if v is not None}) == medium


def test_what_is_given_changes_the_numbers_of_a_preset():
    medium = Medium(preset="smoke", sigma_a=0.5, phase="isotropic")
    assert medium.sigma_s == (0.85, 0.86, 0.88)
    assert medium.sigma_a == (0.5, 0.5, 0.5)
    assert medium.phase.type == "isotropic"


def test_a_preset_replaces_all_that_it_has_numbers_for():
    changed = Medium(preset="smoke", sigma_a=0.5, octaves=3).replace(preset="cloud")
    assert changed == Medium(preset="cloud", octaves=3)
    assert Medium(preset="cloud").replace(sigma_a=0.1).sigma_a == (0.1, 0.1, 0.1)


def test_of_a_scene_file(tmp_path):
    text = '[volume]\nfile = "a.npy"\n[medium]\npreset = "dust"\nsigma_a = 0.25\n'
    medium = read(tmp_path, text).medium
    assert (medium.sigma_s, medium.sigma_a) == ((0.95, 0.94, 0.925), (0.25, 0.25, 0.25))


def test_of_a_body_wins_over_the_scenes_numbers(tmp_path):
    own = 'medium = { preset = "smoke" }'
    text = f'[volume]\nfile = "a.npy"\n{own}\n[medium]\nsigma_s = 0.1\noctaves = 2\n'
    assert read(tmp_path, text).volumes[0].medium == Medium(preset="smoke", octaves=2)


@pytest.mark.parametrize("overrides", [("preset", "sigma_a"), ("sigma_a", "preset")], ids="-then-".join)
def test_of_a_flag_wins_over_the_file_and_other_flags_over_it(tmp_path, overrides):
    text = '[volume]\nfile = "a.npy"\n[medium]\nsigma_s = 0.1\nsigma_a = 0.1\n'
    values = {"preset": "dust", "sigma_a": 0.5}
    medium = read(tmp_path, text, *((f"medium.{key}", values[key]) for key in overrides)).medium
    assert medium == Medium(preset="dust", sigma_a=0.5)


def test_one_that_is_unknown_names_the_nearest(tmp_path):
    with pytest.raises(SceneError, match=r"preset = 'clod': unknown preset 'clod'; did you mean 'cloud'\?"):
        read(tmp_path, '[volume]\nfile = "a.npy"\n[medium]\npreset = "clod"\n')


def test_density_is_scaled_to_what_shows_the_medium(tmp_path):
    text = '[volume]\nfile = "a.npy"\ndensity_scale = "auto"\n[medium]\npreset = "cloud"\n'
    scene = read(tmp_path, text).make(tfm.Scene)
    expected = density_scale_for(tfm.Volume.load(tmp_path / "a.npy"), PRESETS["cloud"].optical_depth)
    assert scene.volume.density_scale == expected
    assert expected > 2 * density_scale_for(scene.volume)
