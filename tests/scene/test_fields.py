"""Fields: does their sum give every body's extinction, and what stays out of the maps?"""

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.scene.fields import MOST_FIELDS, fields_of

DATA = np.ones((3, 4, 5), np.float32)
PLAIN = tfm.Volume(DATA)
COLOURED = tfm.Volume(DATA, colour=np.full((3, 4, 5, 3), (0.5, 1.0, 0.2), np.float32))
WHITE = tfm.Medium(sigma_s=1.0)
DENSE = tfm.Medium(sigma_s=3.0, sigma_a=1.0)
BROWN = tfm.Medium(sigma_s=(0.6, 0.4, 0.2), sigma_a=(0.3, 0.4, 0.5))
BLUE = tfm.Medium(sigma_s=(0.2, 0.5, 1.0))
CLEAR = tfm.Medium(sigma_s=0, sigma_a=0)


def scene_of(*media, volume=PLAIN, others=()):
    camera = tfm.Camera(from_=(0, 0, 9), to=(0, 0, 0))
    light = tfm.SpotLight(from_=(0, 9, 0), to=(0, 0, 0))
    bodies = [volume.with_medium(medium) for medium in media]
    return tfm.Scene([*bodies, *others], camera=camera, lights=[light])


COUNTS = {
    "one medium": ((BROWN,), 1),
    "the same twice": ((BROWN, BROWN), 1),
    "one ratio": ((WHITE, DENSE), 1),
    "two ratios": ((WHITE, BROWN), 2),
    "two ratios of three grids": ((WHITE, BROWN, DENSE), 2),
    "three ratios": ((WHITE, BROWN, BLUE), 3),
    "sixteen": ((WHITE, BROWN, BLUE, DENSE) * 4, 3),
    "a clear one": ((WHITE, CLEAR), 1),
    "nothing but clear": ((CLEAR,), 1),
}


@pytest.mark.parametrize(("media", "count"), COUNTS.values(), ids=COUNTS)
def test_fields_add_up_to_every_grid_s_extinction(media, count):
    fields = fields_of(scene_of(*media))
    assert fields.count == count <= MOST_FIELDS
    for medium, weights in zip(media, fields.weights, strict=True):
        np.testing.assert_allclose(fields.rgb_from_field @ weights[0], medium.sigma_t, rtol=1e-12)
        assert not weights[1:].any()  # a grid without colour has one channel
    assert (fields.extinctions > 0).all()


def test_a_coloured_grid_has_a_field_for_each_colour():
    scene = tfm.Scene([COLOURED.with_medium(BROWN), PLAIN.with_medium(BLUE)])
    fields = fields_of(scene)
    assert fields.count == 3
    for channel in range(3):
        of_channel = fields.rgb_from_field @ fields.weights[0, channel]
        np.testing.assert_allclose(of_channel, np.eye(3)[channel] * BROWN.sigma_t, rtol=1e-12)
    np.testing.assert_allclose(fields.rgb_from_field @ fields.weights[1, 0], BLUE.sigma_t, rtol=1e-12)


def test_what_media_emit_is_in_no_field():
    one, other = (fields_of(scene_of(BROWN, BROWN.replace(emission=glow))) for glow in (0, (1, 2, 3)))
    for name in ("rgb_from_field", "weights", "sigma_t"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_homogeneous_bodies_have_no_field():
    assert fields_of(tfm.Scene(tfm.BoxVolume(medium=BROWN))).count == 0
    fog = tfm.BoxVolume(medium=BROWN)
    assert fields_of(scene_of(WHITE, others=[fog])).first_change(fields_of(scene_of(WHITE))) is None


@pytest.mark.parametrize(
    ("before", "after", "same"),
    [
        ((BROWN, BROWN), (BLUE, BLUE), True),
        ((WHITE, BROWN), (DENSE, BROWN), True),  # stronger, and the only one of its colour
        ((WHITE, BROWN), (BLUE, BROWN), True),
        ((WHITE, DENSE, BROWN), (WHITE, BROWN, BROWN), False),
        ((WHITE, DENSE, BROWN), (WHITE, WHITE, BROWN), False),
        ((WHITE, BROWN), (BROWN, BROWN), False),
    ],
)
def test_what_stays_out_of_the_maps(before, after, same):
    assert (fields_of(scene_of(*before)).first_change(fields_of(scene_of(*after))) is None) is same


def test_the_order_of_grids_changes_no_field():
    one, other = fields_of(scene_of(WHITE, DENSE)), fields_of(scene_of(DENSE, WHITE))
    np.testing.assert_array_equal(one.rgb_from_field, other.rgb_from_field)
    np.testing.assert_array_equal(one.weights, other.weights[::-1])
