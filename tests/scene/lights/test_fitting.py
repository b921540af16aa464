"""Maps of lights with a place look at all that these light of the medium, and at little else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tfm_cl as tfm
from tfm_cl.scene.lights.charts import BORDER, MARGIN, Hemisphere, Octahedron, Perspective
from tfm_cl.scene.lights.fitting import fitted_view

BOUNDS = np.array([[-1.0, -0.5, -2.0], [1.0, 0.7, 0.5]])
ANYWHERE = st.tuples(*[st.floats(-4, 4, width=32)] * 3)


def points_in(bounds, count=4000):
    return np.random.default_rng(3).uniform(*bounds, (count, 3))


def lights(draw):
    from_, to = draw(ANYWHERE), draw(ANYWHERE)
    reach = draw(st.sampled_from([None, 0.5, 3.0]))
    if draw(st.booleans()) or np.linalg.norm(np.subtract(from_, to)) < 0.1:
        return tfm.PointLight(from_=from_, reach=reach)
    cone = draw(st.sampled_from([0.1, 5.0, 30.0, 60.0, 89.0, 89.9]))
    return tfm.SpotLight(from_=from_, to=to, cone=cone, reach=reach)


@given(light=st.composite(lights)())
@settings(max_examples=300, deadline=None, derandomize=True)
def test_all_that_is_lit_is_in_the_map(light):
    points = points_in(BOUNDS)
    lit = points[light.reaches(points)]
    fitted = light.fitted(BOUNDS)

    position = fitted.arrival(lit).position
    assert ((position >= 0) & (position <= 1)).all()
    # Rays through the places lead there again.
    origins, directions = fitted.rays(position)
    towards = (lit - origins) / np.linalg.norm(lit - origins, axis=1, keepdims=True)
    np.testing.assert_allclose(directions, towards, atol=1e-9)


@given(light=st.composite(lights)())
@settings(max_examples=100, deadline=None, derandomize=True)
def test_light_itself_does_not_change(light):
    points = points_in((BOUNDS[0] - 1, BOUNDS[1] + 1), 300)
    fitted = light.fitted(BOUNDS)

    for before, after in zip(light.arrival(points), fitted.arrival(points), strict=True):
        if before.shape != (len(points), 2):  # but its places in the map
            np.testing.assert_array_equal(before, after)
    np.testing.assert_array_equal(light.reaches(points), fitted.reaches(points))
    assert fitted == light or fitted.to_dict() == light.to_dict()


@pytest.mark.parametrize("cone", [40.0, 60.0, 89.0, 89.9, None])
@pytest.mark.parametrize("towards", [(0, 0, 0), (1, 2, -0.5)])
def test_texels_are_spent_where_the_medium_is(cone, towards):
    """From afar a cone's map is as fine as that of the narrow cone which just holds the medium."""
    from_ = (4.0, 6.0, 3.0)
    point = tfm.PointLight(from_=from_)
    light = point if cone is None else tfm.SpotLight(from_=from_, to=towards, cone=cone)
    centre = BOUNDS.mean(axis=0)
    radius = np.linalg.norm(BOUNDS[1] - centre)
    needed = 2 * np.tan(np.arcsin(radius / np.linalg.norm(centre - from_)))

    chart = light.fitted(BOUNDS).view.chart

    assert isinstance(chart, Perspective)
    assert chart.width <= needed
    assert light.fitted(BOUNDS).footprint(2.0) == pytest.approx(2 * chart.width)


def test_a_light_near_a_face_sees_half_of_all_directions():
    above = tfm.PointLight(from_=(0.0, 0.75, -1.0))
    assert isinstance(above.fitted(BOUNDS).view.chart, Hemisphere)
    np.testing.assert_allclose(above.fitted(BOUNDS).view.axes[:, 2], (0, -1, 0), atol=1e-12)


def test_a_light_within_sees_everything():
    within = tfm.PointLight(from_=(0.0, 0.0, 0.0)).fitted(BOUNDS).view
    assert isinstance(within.chart, Octahedron)
    assert within.chart.window == pytest.approx((0.5 - BORDER,) * 2 + (0.5,) * 2)


def test_a_wide_spot_within_sees_its_cone():
    spot = tfm.SpotLight(from_=(0.0, 0.0, 0.0), to=(0, 0, -1), cone=89.9).fitted(BOUNDS).view
    assert isinstance(spot.chart, Hemisphere)
    assert spot.chart.high[0] == pytest.approx(1 + 2 * MARGIN, rel=2e-3)


def test_reach_ends_what_is_looked_at():
    point = tfm.PointLight(from_=(0.0, 2.7, 0.0), reach=2.2)
    near, far = point.fitted(BOUNDS).view.chart, point.replace(reach=None).fitted(BOUNDS).view.chart
    assert near.width < far.width


EVERYWHERE, FAR = np.array([[-np.inf] * 3, [np.inf] * 3]), np.array([[10.0] * 3, [11.0] * 3])


@pytest.mark.parametrize(("bounds", "reach"), [(EVERYWHERE, None), (FAR, 2.0)])
def test_without_anything_to_look_at_the_whole_light_is_mapped(bounds, reach):
    light = tfm.SpotLight(from_=(0, 0, 0), to=(1, 0, 0), cone=30.0, reach=reach)
    assert light.fitted(bounds).map_key() == light.map_key()


def test_a_map_does_not_turn_about_for_nothing():
    """The axis of the spot is kept where another would gain little."""
    spot = tfm.SpotLight(from_=(0, 0, 8), to=(0.1, 0.1, -0.75), cone=20.0)
    axes = fitted_view(np.array(spot.from_), BOUNDS, spot.cone_of_light(), np.inf).axes
    np.testing.assert_array_equal(axes, spot.cone_of_light().axes)


@pytest.mark.parametrize(
    "light", [tfm.PointLight(from_=(3, 2, 1)), tfm.SpotLight(from_=(3, 2, 1), to=(0, 0, 0))]
)
def test_the_next_frame_finds_the_view_fitted(light):
    again = light.replace(intensity=2)
    assert again.fitted(BOUNDS.copy()).view is light.fitted(BOUNDS).view
    for other in (light.replace(reach=2), light.replace(from_=(3, 2, 1.1))):
        assert other.fitted(BOUNDS).view is not light.fitted(BOUNDS).view
    assert light.fitted(BOUNDS + 0.1).view is not light.fitted(BOUNDS).view
