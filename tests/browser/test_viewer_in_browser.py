"""The viewer's page in a real browser: what an artist sees, drags and types, and what the session hears."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from browser_pages import until, watched

from tfm_cl.files.image_io.false_colour import COLOURS
from tfm_cl.scene.movable import said_by
from tfm_cl.scene.scene_file import SceneFile
from tfm_cl.scene.schema import scene_schema
from tfm_cl.sequence import frame as sequence_frame
from tfm_cl.viewer.page import script, style

HOSTILE = '<img src=x onerror="window.owned=1"><b>smoke</b>'
PIXEL = 1.5
"""By which a handle may miss the pointer that drags it: numbers are rounded to six digits."""

SCENE = """
[volume]
shape = "box"
from = [-1.0, -1.0, -1.0]
to = [1.0, 1.0, 1.0]

[camera]
from = [0.5, 1.0, 6.0]
to = [0.0, 0.0, 0.0]
res = [320, 180]

[[light]]
type = "spot"
from = [-1.5, 1.2, 1.0]
to = [0.0, 0.0, 0.0]
cone = 20.0
intensity = [8.0, 6.0, 4.0]

[[light]]
type = "point"
from = [1.2, 0.8, 0.5]

[[solid]]
shape = "sphere"
centre = [0.5, -0.5, 0.5]
radius = 0.3
"""

SESSION = """
window.said = [];
window.view = mount(document.getElementById("viewer"), {
  send: (message) => said.push(message),
  listen: (callbacks) => { window.hear = callbacks; },
  upload: async (file, kind) => {
    said.push({ type: "upload", kind, name: file.name, bytes: (await file.arrayBuffer()).byteLength });
    return file.name;
  },
});
window.picture = async (header, [red, green, blue]) => {
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: header.width, height: header.height });
  const context = canvas.getContext("2d");
  context.fillStyle = `rgb(${red}, ${green}, ${blue})`;
  context.fillRect(0, 0, header.width, header.height);
  const blob = await new Promise((done) => canvas.toBlob(done, "image/png"));
  const bytes = new Uint8Array(await blob.arrayBuffer());
  const told = JSON.stringify({ type: "picture", mime: "image/png", gain: 1, ...header });
  const said = new TextEncoder().encode(told);
  const message = new Uint8Array(4 + said.length + bytes.length);
  new DataView(message.buffer).setUint32(0, said.length, true);
  message.set(said, 4);
  message.set(bytes, 4 + said.length);
  hear.binary(message.buffer);
};
hear.state({ connected: true, line: "" });
"""
"""Stands for a session: what the page says is in ``said``; ``hear`` and ``picture`` talk to the page."""

DRAWN = """(() => {
  const [layers, handles] = [".layers", ".gizmos"].map((name) => document.querySelector(name));
  return handles.viewBox.baseVal.width === layers.clientWidth && handles.querySelector(".handle") !== null;
})()"""
"""Whether handles lie where the picture has them."""

WELCOME = {
    "type": "welcome",
    "version": "0",
    "layers": [{"name": "beauty", "meaning": HOSTILE}, {"name": "depth", "meaning": "how far away"}],
    "views": [{"name": "standard", "summary": "a clip"}, {"name": "filmic", "summary": "a curve"}],
    "presets": [],
    "folder": HOSTILE,
    "most_upload": 1000,
    "shared": False,
    "can": {"open": True, "save": True},
}
SHOW = {"layer": "beauty", "exposure": 0.0, "stops": 0.0, "view": "standard", "light": 0}


@pytest.fixture(scope="module")
def options(tmp_path_factory):
    """All options of the scene, as a session says them."""
    path = tmp_path_factory.mktemp("viewer") / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    file = SceneFile.read(path)
    return json.loads(json.dumps(sequence_frame.read(file, None).options))


class Viewer:
    """A page with a session that only the test answers for."""

    def __init__(self, page, options):
        self.page, self.options, self.revision = page, options, 0
        self.edits = {}
        page.set_content(
            f"<!doctype html><html lang=en><style>{style()}</style><body><main id=viewer></main>"
            f"<script>{script()}{SESSION}</script>"
        )
        self.hear(WELCOME | {"schema": scene_schema()})
        self.state()

    def hear(self, message):
        self.page.evaluate("(message) => hear.message(message)", message)

    def state(self, **changes):
        self.revision += 1
        state = {
            "type": "state",
            "revision": self.revision,
            "source": f"/folder/{HOSTILE}",
            "options": self.options,
            "edits": self.edits,
            "frame": None,
            "frames": None,
            "changing": [],
            "undo": False,
            "redo": False,
            "bounds": [[-1, -1, -1], [1, 1, 1]],
            "show": SHOW,
            "warnings": [],
        }
        self.hear(state | changes)

    def picture(self, number, colour, *, which="a", revision=1, quality="full", **told):
        header = told | {"picture": number, "which": which, "revision": revision, "quality": quality}
        self.page.evaluate(
            "([header, colour]) => picture(header, colour)", [header | {"width": 320, "height": 180}, colour]
        )
        until(self.page, "(n) => said.some(({ type, picture }) => type === 'seen' && picture === n)", number)

    def said(self, kind):
        found = self.page.evaluate("(kind) => said.filter(({ type }) => type === kind)", kind)
        self.page.evaluate("(kind) => { window.said = said.filter(({ type }) => type !== kind); }", kind)
        return found

    def edited(self):
        """Return what the edits since the last call set together; the last one ends a drag."""
        edits = self.said("edit")
        assert edits
        assert edits[-1]["drag"] is False
        assert all(edit["drag"] for edit in edits[:-1])
        return {key: value for edit in edits for key, value in edit["changes"].items()}

    def press(self, *keys):
        """Press keys on the stage."""
        self.page.locator(".view .stage").focus()
        for key in keys:
            self.page.keyboard.press(key)

    @property
    def box(self):
        return SimpleNamespace(**self.page.locator(".layers").bounding_box())

    def place(self, point, camera=None):
        """Return where a point of the world is on the screen."""
        camera = camera or self.options["camera"]
        origin, to, up = (np.array(camera[key], dtype=float) for key in ("from", "to", "up"))
        forward = (to - origin) / np.linalg.norm(to - origin)
        right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
        above = np.cross(right, forward)
        arm = np.array(point) - origin
        reach = np.tan(np.radians(camera["fov"]) / 2) * (arm @ forward)
        x = 0.5 + (arm @ right) / (2 * reach * 16 / 9)
        y = 0.5 - (arm @ above) / (2 * reach)
        return self.box.x + x * self.box.width, self.box.y + y * self.box.height

    def under(self, x, y, camera=None):
        """Return the point of the world at a place on the screen, as far away as the camera's target."""
        camera = camera or self.options["camera"]
        origin, to, up = (np.array(camera[key], dtype=float) for key in ("from", "to", "up"))
        right = np.cross(to - origin, up) / np.linalg.norm(np.cross(to - origin, up))
        above = np.cross(right, to - origin) / np.linalg.norm(to - origin)
        unit = 2 * np.tan(np.radians(camera["fov"]) / 2) * np.linalg.norm(to - origin) / self.box.height
        across, down = x - self.box.x - self.box.width / 2, y - self.box.y - self.box.height / 2
        return to + unit * (across * right - down * above)

    def drag(self, start, *, by, button="left"):
        mouse = self.page.mouse
        mouse.move(*start)
        mouse.down(button=button)
        mouse.move(start[0] + by[0] / 2, start[1] + by[1] / 2, steps=4)
        mouse.move(start[0] + by[0], start[1] + by[1], steps=4)
        mouse.up(button=button)

    def centre(self, dx=0.25, dy=0.35):
        """Return a place of the picture where no handle is."""
        return self.box.x + dx * self.box.width, self.box.y + (0.5 + dy) * self.box.height

    def colour(self):
        """Return the colour that the stage shows, of a corner where nothing lies over it."""
        return self.page.evaluate(
            """() => {
              const [shown] = document.querySelectorAll(".layer.shown");
              const context = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
              context.drawImage(shown, -5, -5);
              return [...context.getImageData(0, 0, 1, 1).data].slice(0, 3);
            }"""
        )


@pytest.fixture
def view(browser, options):
    """``view(**context)`` opens a page; at the end, nothing was fetched and nothing complained."""
    opened = []

    def view(**context):
        seen = watched(browser, **context)
        opened.append(seen)
        viewer = Viewer(seen.page, options)
        viewer.picture(1, [200, 0, 0])
        until(seen.page, DRAWN)
        viewer.said("seen")
        return viewer

    yield view
    for seen in opened:
        assert seen.page.evaluate("window.owned") is None
        assert seen.page.locator("b").count() == 0
        seen.context.close()
        assert seen.requests == []
        assert seen.complaints == []


@pytest.fixture
def viewer(view):
    return view()


@pytest.mark.slow
def test_pictures_only_get_better(viewer):
    viewer.picture(2, [0, 200, 0], quality="low")
    assert viewer.colour() == [200, 0, 0]  # of the same revision, and finished
    viewer.picture(3, [0, 0, 200], revision=2, quality="low")
    assert viewer.colour() == [0, 0, 200]
    viewer.picture(4, [0, 200, 0], revision=1)
    assert viewer.colour() == [0, 0, 200]  # older
    viewer.picture(5, [200, 200, 0], revision=2)
    assert viewer.colour() == [200, 200, 0]
    assert [seen["picture"] for seen in viewer.said("seen")] == [2, 3, 4, 5]


@pytest.mark.slow
@pytest.mark.parametrize("colours", COLOURS)
def test_what_colours_mean_is_told(viewer, colours):
    bar = viewer.page.locator(".scale-bar")
    assert bar.is_hidden()
    viewer.picture(2, [0, 200, 0], revision=2, range=[0.5, 8.25], colours=colours)
    assert bar.text_content() == "0.58.25"
    drawn = bar.locator("i").evaluate("(bar) => getComputedStyle(bar).backgroundImage")
    stops = COLOURS[colours]
    assert drawn.startswith(f"linear-gradient(to right, rgb{stops[0]}, rgb{stops[1]}, ")
    assert drawn.endswith(f"rgb{stops[-1]})")


@pytest.mark.slow
def test_a_new_connection_begins_anew(viewer):
    viewer.picture(2, [0, 0, 200], revision=9)
    viewer.page.evaluate("hear.state({ connected: false, line: 'gone <b>away</b>' })")
    assert viewer.page.locator(".alert").text_content() == "gone <b>away</b>"
    viewer.page.evaluate("hear.state({ connected: true, line: '' })")
    assert viewer.page.locator(".alert").is_hidden()
    viewer.picture(3, [0, 200, 0], revision=1, quality="low")
    assert viewer.colour() == [0, 200, 0]


@pytest.mark.slow
def test_the_camera_turns_about_its_target(viewer):
    before = viewer.options["camera"]
    viewer.drag(viewer.centre(), by=(120, 40))
    changes = viewer.edited()
    assert set(changes) == {"camera.from", "camera.to"}
    assert np.allclose(changes["camera.to"], before["to"], atol=1e-6)
    arms = [np.subtract(camera, before["to"]) for camera in (changes["camera.from"], before["from"])]
    assert np.linalg.norm(arms[0]) == pytest.approx(np.linalg.norm(arms[1]), rel=1e-5)
    assert arms[0][0] < arms[1][0]  # the scene follows the pointer to the right
    assert arms[0][1] > arms[1][1]  # and down


@pytest.mark.slow
@pytest.mark.parametrize(("apart", "by"), [(120, 0), (-30, 90)], ids=["apart", "together and aside"])
def test_two_fingers_move_the_camera(view, apart, by):
    viewer = view(has_touch=True)
    touch = viewer.page.context.new_cdp_session(viewer.page)
    x, y = viewer.centre()

    def fingers(kind, *places):
        points = [{"x": place, "y": y, "id": number} for number, place in enumerate(places)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    fingers("touchStart", x - 60)
    fingers("touchStart", x - 60, x + 60)
    for part in np.linspace(0.2, 1, 5):
        fingers("touchMove", x - 60 + part * (by - apart / 2), x + 60 + part * (by + apart / 2))
    fingers("touchEnd")

    changes, before = viewer.edited(), viewer.options["camera"]
    arms = [np.subtract(camera["from"], camera["to"]) for camera in (before, _camera(changes))]
    nearer = 120 / (120 + apart)
    assert np.allclose(arms[1], nearer * arms[0], rtol=1e-3, atol=1e-4)
    # What is between the fingers goes with them.
    now = viewer.place(viewer.under(x, y), before | _camera(changes))
    assert np.allclose(now, [x + by, y], atol=PIXEL)


def _camera(changes):
    return {key: changes[f"camera.{key}"] for key in ("from", "to")}


def _far(camera):
    return np.linalg.norm(np.subtract(camera["from"], camera["to"]))


@pytest.mark.slow
def test_a_camera_of_a_matrix_turns_too(viewer):
    matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 6], [0, 0, 0, 1]]
    camera = viewer.options["camera"] | {"from": None, "to": None, "up": None, "matrix": matrix}
    viewer.state(options=viewer.options | {"camera": camera})
    viewer.drag(viewer.centre(), by=(120, 0))
    changes = viewer.edited()
    assert set(changes) == {"camera.from", "camera.to", "camera.up"}
    assert np.allclose(changes["camera.to"], 0, atol=1e-5)  # the middle of what there is
    assert np.linalg.norm(changes["camera.from"]) == pytest.approx(6, rel=1e-4)
    turned = np.degrees(np.arctan2(-changes["camera.from"][0], changes["camera.from"][2]))
    assert turned == pytest.approx(180 * 120 / viewer.box.height, rel=0.05)


@pytest.mark.slow
def test_the_picture_never_turns_over(viewer):
    for by in (2000, -4000):
        viewer.drag(viewer.centre(), by=(0, by))
        origin = np.array(viewer.edited()["camera.from"])
        assert 0 < np.degrees(np.arccos(abs(origin[1]) / np.linalg.norm(origin))) < 3
        assert origin[1] * by > 0


@pytest.mark.slow
@pytest.mark.parametrize("way", ["middle", "shift"])
def test_a_shift_follows_the_pointer(viewer, way):
    start = viewer.place([0, 0, 0])
    if way == "shift":
        viewer.page.keyboard.down("Shift")
    viewer.drag(viewer.centre(), by=(60, -30), button="middle" if way == "middle" else "left")
    changes = viewer.edited()
    camera = viewer.options["camera"] | {"from": changes["camera.from"], "to": changes["camera.to"]}
    assert np.allclose(viewer.place([0, 0, 0], camera), np.add(start, [60, -30]), atol=PIXEL)


@pytest.mark.slow
def test_wheel_right_button_and_f_go_nearer_and_away(viewer):
    far, place = _far(viewer.options["camera"]), viewer.centre(0.8, -0.3)
    under = viewer.under(*place)
    viewer.page.mouse.move(*place)
    viewer.page.mouse.wheel(0, -240)
    until(viewer.page, "said.some(({ type, drag }) => type === 'edit' && !drag)")
    wheeled = viewer.options["camera"] | _camera(viewer.edited())
    assert _far(wheeled) < 0.9 * far
    assert np.allclose(viewer.place(under, wheeled), place, atol=PIXEL)  # what is under the pointer stays
    viewer.drag(viewer.centre(), by=(0, 80), button="right")
    dragged = _camera(viewer.edited())
    assert _far(dragged) > 1.1 * _far(wheeled)
    assert np.allclose(dragged["to"], wheeled["to"], atol=1e-6)
    viewer.page.keyboard.press("f")
    camera = viewer.options["camera"] | _camera(viewer.edited())
    corners = np.stack(np.meshgrid(*[[-1, 1]] * 3), -1).reshape(-1, 3)
    places = np.array([viewer.place(corner, camera) for corner in corners])
    inside = places - [viewer.box.x, viewer.box.y]
    assert (inside > 0).all()
    assert (inside < [viewer.box.width, viewer.box.height]).all()
    assert np.ptp(inside[:, 1]) > 0.5 * viewer.box.height


@pytest.mark.slow
def test_a_light_is_dragged_by_its_handle(viewer):
    light = viewer.options["light"][0]
    start = viewer.place(light["from"])
    viewer.drag(start, by=(50, 30))
    changes = viewer.edited()
    assert set(changes) == {"light.0.from"}
    assert np.allclose(viewer.place(changes["light.0.from"]), np.add(start, [50, 30]), atol=PIXEL)
    assert viewer.page.locator('details[data-path="light.0"]').get_attribute("class") == "item chosen"


@pytest.mark.slow
def test_an_axis_moves_along_itself(viewer):
    viewer.page.locator('[data-handle="solid.0:from"]').click()
    handle = viewer.page.locator('[data-handle="solid.0/move-x"] .hit')
    x, y = handle.evaluate(
        """(path) => {
          const [at, matrix] = [path.getPointAtLength(0.8 * path.getTotalLength()), path.getScreenCTM()];
          return [at.x * matrix.a + matrix.e, at.y * matrix.d + matrix.f];
        }"""
    )
    viewer.drag((x, y), by=(40, 0))
    changes = viewer.edited()
    assert set(changes) == {"solid.0.translate"}
    fields = viewer.page.locator('[data-path="solid.0"] [data-key="rotate"] .number')
    assert [one.input_value() for one in fields.all()] == ["0"] * 3  # though no file says so
    moved, *others = changes["solid.0.translate"]
    assert moved > 0
    assert others == [0, 0]


@pytest.mark.slow
def test_handles_by_keyboard(viewer):
    aim = viewer.page.locator('[data-handle="light.0:from"]')
    aim.focus()
    viewer.page.keyboard.press("ArrowUp")
    changes = viewer.edited()
    assert changes["light.0.from"][1] > viewer.options["light"][0]["from"][1]
    viewer.page.keyboard.press("Enter")
    cone = viewer.page.locator('[data-handle="light.0/cone-handle"]')
    assert cone.get_attribute("role") == "slider"
    cone.focus()
    viewer.page.keyboard.press("Shift+ArrowRight")
    assert viewer.edited() == {"light.0.cone": 30}
    viewer.page.keyboard.press("g")
    assert viewer.page.locator(".handle").count() == 0
    viewer.page.keyboard.press("g")
    assert viewer.page.locator(".handle").count() > 3


@pytest.mark.slow
def test_every_handle_can_be_hit(viewer):
    viewer.page.locator('[data-handle="light.0:from"]').click()
    sizes = viewer.page.evaluate(
        """() => [...document.querySelectorAll(".handle .hit")].map((hit) => {
          const box = hit.getBBox();
          const width = hit.classList.contains("line") ? Number(hit.getAttribute("stroke-width")) : 0;
          return Math.min(box.width, box.height) + width;
        })"""
    )
    assert len(sizes) > 8
    assert min(sizes) >= 22  # 24 where text has the browser's usual size


@pytest.mark.slow
def test_numbers_choices_and_colours(viewer):
    page = viewer.page
    light = page.locator('details[data-path="light.0"]')
    red = light.locator('[data-key="intensity"] [data-axis="r"]')
    red.fill("12.5")
    red.press("Enter")
    assert viewer.edited() == {"light.0.intensity": [12.5, 6, 4]}
    red.press("ArrowUp")
    assert viewer.edited()["light.0.intensity"][0] > 12.5
    basis = page.locator('[data-section="map"] [data-key="basis"] select')
    basis.select_option("dct")
    assert viewer.edited() == {"map.basis": "dct"}
    page.locator('[data-section="map"] [data-key="res"] button.small').click()
    assert viewer.edited() == {"map.res": "auto"}
    page.locator('[data-section="medium"] [data-key="phase"] select').select_option("hg")
    assert viewer.edited() == {"medium.phase": {"type": "hg", "g": 0.0}}
    slider = light.locator('[data-key="cone"] input[type="range"]')
    slider.focus()
    page.keyboard.press("ArrowRight")
    assert 20 < viewer.edited()["light.0.cone"] < 22
    page.locator('[data-section="medium"] [data-key="octaves"] input[type="range"]').focus()
    page.keyboard.press("ArrowRight")
    assert viewer.edited() == {"medium.octaves": 2}


@pytest.mark.slow
def test_a_slider_is_one_step_however_it_is_left(viewer):
    slider = viewer.page.locator('details[data-path="light.0"] [data-key="cone"] input[type="range"]')
    box = slider.bounding_box()
    at = box["x"] + 0.5 * box["width"], box["y"] + box["height"] / 2
    viewer.drag(at, by=(15, 0))
    assert viewer.edited()["light.0.cone"] > 45
    mouse = viewer.page.mouse
    mouse.move(at[0] + 15, at[1])
    mouse.down()
    mouse.move(at[0] + 25, at[1], steps=3)
    mouse.move(at[0] + 15, at[1], steps=3)  # back to where it was
    mouse.up()
    until(viewer.page, "said.filter(({ type }) => type === 'edit').at(-1)?.drag === false")
    assert viewer.edited()["light.0.cone"] > 45


@pytest.mark.slow
def test_what_is_out_of_range_is_said_by_the_session(viewer):
    cone = viewer.page.locator('details[data-path="light.0"] [data-key="cone"] .number')
    cone.fill("95")
    cone.press("Enter")
    assert viewer.edited() == {"light.0.cone": 95}
    viewer.hear({"type": "failed", "line": "light.0.cone = 95: should be less than 90"})
    assert viewer.page.locator(".alert").text_content() == "light.0.cone = 95: should be less than 90"
    viewer.hear({"type": "cleared"})
    assert viewer.page.locator(".alert").is_hidden()
    cone.blur()
    viewer.state()
    until(
        viewer.page,
        "document.querySelector('[data-path=\"light.0\"] [data-key=cone] .number').value === '20'",
    )


@pytest.mark.slow
def test_phase_functions_are_mixed_and_listed(viewer):
    page, key = viewer.page, "medium.phase"

    def told():
        phase = viewer.edited()[key]
        viewer.state(options=viewer.options | {"medium": viewer.options["medium"] | {"phase": phase}})
        return phase

    row = page.locator('[data-section="medium"] [data-key="phase"]')
    row.locator("select").first.select_option("mix")
    before = viewer.options["medium"]["phase"]
    assert told() == {"type": "mix", "phases": [before, {"type": "rayleigh"}], "weights": [1, 1]}
    page.get_by_label("phase, part 1: mix weight").last.fill("3")
    page.keyboard.press("Enter")
    assert told()["weights"] == [3, 1]
    row.get_by_role("button", name="Add a part").click()
    assert told()["phases"][2] == {"type": "isotropic"}
    page.get_by_label("phase, part 3", exact=True).select_option("double-hg")
    told()
    names = row.locator(".parts > .phase").last.locator(".name").all_text_contents()
    assert sorted(names) == ["g1", "g2", "mix weight", "weight"]
    page.get_by_label("phase, part 3", exact=True).select_option("hg")
    phase = told()
    assert (phase["phases"][2], phase["weights"]) == ({"type": "hg", "g": 0.0}, [3, 1, 1])
    page.get_by_role("button", name="Remove phase, part 2").click()
    phase = told()
    assert (phase["phases"], phase["weights"]) == ([before, {"type": "hg", "g": 0.0}], [3, 1])
    row.locator("select").first.select_option("table")
    assert told() == {"type": "table", "values": [1, 1]}
    values = page.get_by_label("phase values")
    assert values.input_value() == "1 1"
    values.fill("1, 0.5 4")
    values.press("Enter")
    assert told() == {"type": "table", "values": [1, 0.5, 4]}


TURNED = said_by({"translate": [1, 0.5, -2], "rotate": [10, 20, -30], "scale": [-2, 0.5, 1]})
SHEARED = [1, 0.123456789, 0, 0.2, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


def _placed(viewer, matrix):
    """Let a matrix place the solid; return what the panel shows of its row ``name``, as a function."""
    solid = viewer.options["solid"][0] | {"transform": np.reshape(matrix, (4, 4)).tolist()}
    viewer.state(options=viewer.options | {"solid": [solid]})
    viewer.page.locator('[data-section="solid"] > summary').click()
    viewer.page.locator('[data-path="solid.0"] > summary').click()
    return lambda name: viewer.page.locator(f'[data-path="solid.0"] [data-key="{name}"]')


@pytest.mark.slow
def test_a_matrix_is_shown_and_changed_in_steps(viewer):
    row = _placed(viewer, TURNED)

    def shown():
        fields = [row(name).locator(".number") for name in ("translate", "rotate", "scale")]
        return [[float(one.input_value()) for one in field.all()] for field in fields]

    assert shown() == [[1, 0.5, -2], [10, 20, -30], [-2, 0.5, 1]]
    row("rotate").locator('[data-axis="y"]').fill("45")
    viewer.page.keyboard.press("Enter")
    said = {"solid.0.translate": [1, 0.5, -2], "solid.0.rotate": [10, 45, -30], "solid.0.scale": [-2, 0.5, 1]}
    assert viewer.edited() == said
    assert shown()[1] == [10, 45, -30]
    # So do handles.
    handle = viewer.page.locator('[data-handle="solid.0/move-x"]')
    handle.focus()
    viewer.page.keyboard.press("ArrowRight")
    moved = viewer.edited()
    assert set(moved) == {"solid.0.translate"}
    assert moved["solid.0.translate"][0] > 1
    # The session has them now, and each goes back with the others: the file has a matrix.
    viewer.edits = said = said | moved
    steps = {key.rpartition(".")[2]: value for key, value in said.items()}
    viewer.state(
        options=viewer.options | {"solid": [viewer.options["solid"][0] | steps | {"transform": None}]}
    )
    edited = "[...document.querySelectorAll('[data-path=\"solid.0\"] .edited')].map((one) => one.dataset.key)"
    until(viewer.page, f"{edited}.join() === 'translate,rotate'")
    row("rotate").locator(".back").click()
    assert viewer.edited() == dict.fromkeys(said)


@pytest.mark.slow
def test_a_handle_of_what_a_matrix_places_changes_all_steps(viewer):
    _placed(viewer, TURNED)
    viewer.press("e")
    viewer.page.locator('[data-handle="solid.0/rotate-y"]').focus()
    viewer.page.keyboard.press("ArrowRight")
    changes = viewer.edited()
    assert set(changes) == {"solid.0.translate", "solid.0.rotate", "solid.0.scale"}
    then = said_by({key.rpartition(".")[2]: value for key, value in changes.items()})
    turn = said_by({"rotate": [0, 1, 0]})
    assert np.allclose(then[:3, :3], (turn @ TURNED)[:3, :3], atol=1e-5)  # six digits are written


@pytest.mark.slow
def test_a_matrix_that_shears_keeps_its_numbers(viewer):
    row = _placed(viewer, SHEARED)
    assert row("translate").count() == row("rotate").count() == row("scale").count() == 0
    field = row("transform").locator(".text")
    assert field.is_visible()
    field.fill(field.input_value().replace("0.2", "3", 1))
    field.press("Enter")
    assert viewer.edited() == {"solid.0.transform": [*SHEARED[:3], 3, *SHEARED[4:]]}


@pytest.mark.slow
def test_a_table_of_a_phase_function_is_chosen_and_sent(viewer):
    page = viewer.page

    def shown(phase):
        viewer.state(options=viewer.options | {"medium": viewer.options["medium"] | {"phase": phase}})

    def told():
        return viewer.edited()["medium.phase"]

    shown({"type": "table", "values": [1, 2]})
    page.get_by_role("button", name="phase file: choose a file").click()
    assert viewer.said("list") == [{"type": "list", "kind": "phase", "path": ""}]
    viewer.hear({"type": "listing", "kind": "phase", "path": "a", "folders": [], "files": ["b.txt"]})
    page.get_by_role("button", name="b.txt").click()
    chosen = {"type": "table", "file": f"{HOSTILE}/a/b.txt"}  # the folder and the path in it
    assert told() == chosen
    shown(chosen)
    path = page.get_by_label("phase file", exact=True)
    assert path.input_value() == "a/b.txt"
    assert page.get_by_label("phase values").count() == 0

    page.get_by_role("button", name="phase file: choose a file").click()
    sent = {"name": "c.csv", "mimeType": "text/csv", "buffer": b"-1 1"}
    page.locator("dialog[open] input[type=file]").set_input_files(sent)
    until(page, "said.some(({ type }) => type === 'edit')")
    assert told() == chosen | {"file": f"{HOSTILE}/c.csv"}
    assert page.locator(".message").text_content() == "Sent c.csv"
    assert viewer.said("upload") == [{"type": "upload", "kind": "phase", "name": "c.csv", "bytes": 4}]
    path.fill("/elsewhere/d.dat")
    path.press("Enter")
    assert told() == chosen | {"file": "/elsewhere/d.dat"}
    # The listing is there before the dialog is open: its first file has the focus all the same.
    page.evaluate(
        """(message) => {
          document.querySelector('[aria-label="phase file: choose a file"]').click();
          hear.message(message);
        }""",
        {"type": "listing", "kind": "phase", "path": "", "folders": [], "files": ["e.txt"]},
    )
    until(page, "document.activeElement.textContent === 'e.txt'")
    page.keyboard.press("Enter")
    assert told() == chosen | {"file": f"{HOSTILE}/e.txt"}
    path.fill("")
    path.press("Enter")
    assert told() == {"type": "table", "values": [1, 1]}


@pytest.mark.slow
def test_what_was_changed_is_marked_and_taken_back(viewer):
    row = viewer.page.locator('[data-section="map"] [data-key="steps"]')
    assert "edited" not in row.get_attribute("class")
    viewer.edits = {"map.steps": 50, "camera.fov": 30.0}
    viewer.state()
    until(viewer.page, "document.querySelector('[data-section=map] [data-key=steps]').matches('.edited')")
    row.locator(".back").click()
    assert viewer.edited() == {"map.steps": None}
    viewer.page.keyboard.press("Escape")
    viewer.page.get_by_role("button", name="Take all changes back").click()
    assert viewer.said("reset") == [{"type": "reset"}]


@pytest.mark.slow
def test_the_search_finds_keys(viewer):
    page = viewer.page
    viewer.press("/")
    page.keyboard.type("sigma")
    names = page.locator(".row:visible .name").all_text_contents()
    assert {"sigma s", "sigma a"} <= set(names)
    assert "cone" not in names
    page.keyboard.press("Escape")
    assert "cone" in page.locator(".row:visible .name").all_text_contents()


@pytest.mark.slow
def test_lights_are_added_and_removed_whole(viewer):
    page = viewer.page
    page.locator(".adder").first.select_option("sun")
    changes = viewer.edited()
    assert list(changes) == ["light"]
    assert [light["type"] for light in changes["light"]] == ["spot", "point", "sun"]
    assert len(changes["light"][2]["from"]) == len(changes["light"][2]["to"]) == 3
    assert None not in changes["light"][0].values()
    page.locator('details[data-path="light.1"] > summary .icon-button').click()
    assert [light["type"] for light in viewer.edited()["light"]] == ["spot", "sun"]


@pytest.mark.slow
def test_comparing(viewer):
    page = viewer.page
    page.locator(".view .stage").focus()
    assert page.get_by_role("button", name="B", exact=True).first.is_disabled()
    page.keyboard.press("k")
    assert viewer.said("keep") == [{"type": "keep"}]
    page.keyboard.press("d")
    assert viewer.said("compare") == [{"type": "compare", "with": "dual"}]
    viewer.picture(2, [0, 200, 0], which="b")
    viewer.picture(3, [0, 0, 200], which="error")
    viewer.hear({"type": "compared", "with": "dual", "ssim": 0.99, "psnr": None, "rmse": 0.01})
    assert page.locator(".figures").text_content() == "SSIM 0.9900 · RMSE 0.01"
    divider = page.locator(".divider")
    assert divider.get_attribute("aria-valuenow") == "50"
    divider.focus()
    page.keyboard.press("End")
    assert divider.get_attribute("aria-valuenow") == "100"
    viewer.press("1")
    assert viewer.colour() == [200, 0, 0]
    page.keyboard.down(" ")
    assert viewer.colour() == [0, 200, 0]
    page.keyboard.up(" ")
    assert viewer.colour() == [200, 0, 0]
    page.keyboard.press("3")
    assert viewer.colour() == [0, 0, 200]
    page.keyboard.press("d")
    assert viewer.said("compare") == [{"type": "compare", "with": "nothing"}]
    assert viewer.colour() == [200, 0, 0]
    page.keyboard.press("d")
    viewer.hear({"type": "opened"})  # another scene: nothing is compared, and nothing kept
    assert page.get_by_role("button", name="B", exact=True).first.is_disabled()
    assert not page.locator(".figures").is_visible()
    assert len(viewer.said("compare")) == 1


@pytest.mark.slow
def test_a_curve_is_picked_and_read(viewer):
    page = viewer.page
    page.keyboard.down("Control")
    page.mouse.click(*viewer.centre(0.25, 0.25))
    page.keyboard.up("Control")
    (picked,) = viewer.said("pick")
    assert picked == {
        "type": "pick",
        "x": pytest.approx(0.25, abs=0.01),
        "y": pytest.approx(0.75, abs=0.01),
        "light": 0,
    }
    z = np.linspace(1, 3, 50)
    lines = [np.exp(-k * z).tolist() for k in (1, 1, 1)]
    curve = {
        "type": "curve",
        "light": 0,
        "point": [0, 0, 0],
        "z": z.tolist(),
        "z_point": 2.0,
        "lines": [HOSTILE],
    }
    viewer.hear(curve | {"map": lines, "marched": lines})
    plot = page.locator(".plot")
    assert plot.locator("path.map").count() == plot.locator("path.marched").count() == 1
    box = plot.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert "marched 0.1" in page.locator(".reading").text_content()
    viewer.hear(curve | {"map": [lines[0], (0.5 * z).tolist(), lines[2]], "marched": lines})
    assert plot.locator("path.map").count() == 3
    page.get_by_role("button", name="Close the curve").click()
    assert page.locator(".curve").is_hidden()


@pytest.mark.slow
def test_coefficients_of_any_field_are_shown(viewer):
    viewer.press("m")
    field = viewer.page.get_by_label("Field of the map")
    assert viewer.said("map") == [{"type": "map", "light": 0, "coefficient": 0, "field": 0}]
    shown = {"which": "map", "light": 0, "coefficient": 0}
    viewer.picture(2, [0, 0, 9], **shown, field=0, fields=1)
    assert field.is_hidden()
    viewer.picture(3, [0, 0, 9], **shown, field=0, fields=3)
    assert field.locator("option").all_text_contents() == ["red", "green", "blue"]
    field.select_option("blue")
    assert viewer.said("map") == [{"type": "map", "light": 0, "coefficient": 0, "field": 2}]
    viewer.picture(4, [0, 0, 9], **shown, field=1, fields=2)
    assert field.input_value() == "1"
    label = viewer.page.locator(".layer.shown").get_attribute("aria-label")
    assert label.startswith("coefficient 0 of")
    assert label.endswith("field 2")


@pytest.mark.slow
def test_what_a_picture_cost_is_told(viewer):
    cost = {
        "type": "cost",
        "revision": 1,
        "quality": "low",
        "resolution": [320, 180],
        "rate": 12.3,
        "latency": 0.052,
    }
    viewer.hear(cost | {"seconds": {"view_pass": 0.021, "total": 0.03}, "made": {}})
    chips = viewer.page.locator(".costs").text_content()
    for text in ("320 × 180", "view pass 21 ms", "no new map", "12.3 frames/s", "52 ms after input"):
        assert text in chips
    viewer.hear(cost | {"seconds": {}, "made": {"map": 2}})
    assert "2 new maps" in viewer.page.locator(".costs").text_content()
    viewer.hear({"type": "work", "stage": "light pass", "fraction": 0.5})
    assert viewer.page.locator(".status progress").evaluate("(bar) => bar.value") == 0.5
    viewer.hear({"type": "work", "stage": "compiling kernels: view pass", "fraction": 0})
    work = "document.querySelector('.work').textContent"
    assert viewer.page.evaluate(work) == "compiling kernels: view pass"
    until(viewer.page, f"{work} === 'compiling kernels: view pass, 1 s'")
    viewer.hear({"type": "work", "stage": "", "fraction": 1})
    assert viewer.page.evaluate(work) == ""
    assert viewer.page.locator(".status progress").is_hidden()


@pytest.mark.slow
def test_frames_are_scrubbed_and_played(viewer):
    page = viewer.page
    assert page.locator(".timeline").is_hidden()
    viewer.state(frame=3, frames=[1, 5])
    viewer.press(".")
    assert viewer.said("frame") == [{"type": "frame", "frame": 4, "drag": False}]
    page.keyboard.press("p")
    until(page, "said.some(({ type }) => type === 'frame')")
    assert viewer.said("frame") == [{"type": "frame", "frame": 5, "drag": True}]
    viewer.state(frame=5, frames=[1, 5])
    viewer.picture(2, [0, 0, 9], revision=viewer.revision, quality="low")
    until(page, "said.some(({ type }) => type === 'frame')")
    assert viewer.said("frame") == [{"type": "frame", "frame": 1, "drag": True}]
    page.keyboard.press("p")
    assert viewer.said("frame") == [{"type": "frame", "frame": 1, "drag": False}]


@pytest.mark.slow
def test_undo_save_and_open(viewer):
    page = viewer.page
    viewer.press("Control+z", "Control+Shift+z")
    assert [viewer.said("undo"), viewer.said("redo")] == [[{"type": "undo"}], [{"type": "redo"}]]
    viewer.state(show=SHOW | {"exposure": 1.5})
    page.keyboard.press("Control+s")
    page.locator("dialog[open] .text").fill("mine")
    page.keyboard.press("Enter")
    assert viewer.edited() == {"image.exposure": 1.5}  # what is seen is what is saved
    assert viewer.said("save") == [{"type": "save", "what": "scene", "name": "mine"}]
    page.keyboard.press("Control+o")
    assert viewer.said("list") == [{"type": "list", "kind": "scene", "path": ""}]
    listing = {"type": "listing", "path": "clouds", "folders": [HOSTILE]}
    viewer.hear(listing | {"kind": "scene", "files": ["a.vdb"]})
    viewer.hear(listing | {"kind": "phase", "files": ["a.txt"]})
    page.get_by_role("button", name="a.vdb").click()
    assert viewer.said("open") == [{"type": "open", "path": "clouds/a.vdb"}]


@pytest.mark.slow
def test_a_dropped_file_is_sent_unless_it_is_too_large(viewer):
    drop = """(size) => {
      const data = new DataTransfer();
      data.items.add(new File([new Uint8Array(size)], "cloud.vdb"));
      const drop = new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true });
      document.querySelector(".stage").dispatchEvent(drop);
    }"""
    viewer.page.evaluate(drop, 10)
    until(viewer.page, "said.some(({ type }) => type === 'upload')")
    assert viewer.said("upload") == [{"type": "upload", "kind": "scene", "name": "cloud.vdb", "bytes": 10}]
    viewer.page.evaluate(drop, 2000)
    assert "at most 1 kB" in viewer.page.locator(".alert").text_content()
    assert viewer.said("upload") == []


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1280, 800), (1920, 1080), (3840, 2160)])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_and_can_be_read(view, size, scheme):
    width, height = size
    page = view(viewport={"width": width, "height": height}, color_scheme=scheme).page
    assert page.locator("#viewer").get_attribute("data-theme") == scheme
    found = page.evaluate(
        """() => {
          const all = (selector) => [...document.querySelectorAll(selector)];
          const seen = (selector) => all(selector).filter((one) => one.offsetParent);
          const texts = seen(".row .name, .legend, .chip, button").filter((one) => one.textContent.trim());
          const sizes = texts.map((one) => parseFloat(getComputedStyle(one).fontSize));
          return {
            page: [document.documentElement.scrollWidth, document.documentElement.scrollHeight],
            text: Math.min(...sizes.filter((size) => size > 0)), // a button of a sign has none
            beyond: seen(".row").filter((row) => row.scrollWidth > row.clientWidth + 1).length,
          };
        }"""
    )
    assert found["page"] == [width, height]
    assert found["text"] >= max(11, width / 240)
    assert found["beyond"] == 0
    stage = page.locator(".layers").bounding_box()
    assert stage["width"] * stage["height"] > 0.3 * width * height
    page.get_by_role("button", name=f"Use {'dark' if scheme == 'light' else 'light'} colours").click()
    assert page.locator("#viewer").get_attribute("data-theme") != scheme


BEYOND = """() => {
  const room = document.querySelector(".panel .sections");
  const right = room.getBoundingClientRect().left + room.clientWidth;
  const all = [...room.querySelectorAll("button, input, select, label")];
  const controls = all.filter((one) => one.offsetParent);
  const isBeyond = (one) => {
    const group = one.closest(".line, .several, .parts, summary, .section-body").getBoundingClientRect();
    const box = one.getBoundingClientRect();
    return box.left < group.left - 0.5 || box.right > Math.min(group.right, right) + 0.5;
  };
  const name = (one) => `${one.closest("[data-path]")?.dataset.path} ${one.getAttribute("aria-label")}`;
  const phases = controls.filter((one) => one.closest(".phase")).length;
  return { phases, beyond: controls.filter(isBeyond).map(name) };
}"""
"""How many controls phase functions have, and which of the panel stick out of their group or of the panel."""


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (1280, "dark"), (500, "light")])
def test_no_control_sticks_out_of_the_panel(view, width, scheme):
    viewer = view(viewport={"width": width, "height": 800}, color_scheme=scheme)
    kinds = {section: _kinds(section) for section in ("phase", "light", "solid")}
    parts = [kinds["phase"][kind] for kind in ("hg", "double-hg", "draine", "mie")]
    parts += [{"type": "table"} | said for said in ({"values": [1, 0.5, 4]}, {"file": "a/long/name.txt"})]
    phase = {"type": "mix", "phases": parts, "weights": [0.12345] * len(parts)}
    options = viewer.options | {"medium": viewer.options["medium"] | {"phase": phase}}
    # More than one volume, each with a medium of its own: groups in groups.
    options["volume"] = [options["volume"] | {"name": name, "medium": options["medium"]} for name in "ab"]
    viewer.state(options=options | {name: [*kinds[name].values()] for name in ("light", "solid")})
    for _ in range(3):  # what is opened makes further groups
        viewer.page.evaluate("for (const one of document.querySelectorAll('.panel details')) one.open = true")
        viewer.page.wait_for_timeout(100)
    found = viewer.page.evaluate(BEYOND)
    assert found["phases"] > 3 * 3 * len(parts)  # of three media: each part's kind, numbers and weight
    assert found["beyond"] == []


def _kinds(section):
    """Return a table of each kind that a section of scene files has, with all keys that have a default."""
    tables = {}
    for one in scene_schema()["$defs"][section]["oneOf"]:
        keys = {
            key: said for key, said in one.get("properties", {}).items() if set(said) & {"const", "default"}
        }
        table = {key: said.get("const", said.get("default")) for key, said in keys.items()}
        if "type" in table or "shape" in table:
            tables[table.get("type") or table["shape"]] = table
    return tables


@pytest.mark.slow
def test_everything_has_a_name(viewer):
    viewer.page.locator('[data-handle="light.0:from"]').click()
    nameless = viewer.page.evaluate(
        """() => {
          const text = (one) => one.getAttribute("aria-label") || one.textContent.trim();
          const named = (one) => text(one) || one.labels?.length;
          return [...document.querySelectorAll("button, input, select, summary, [tabindex='0']")]
            .filter((one) => one.offsetParent !== null || one instanceof SVGElement)
            .filter((one) => !named(one))
            .map((one) => one.outerHTML.slice(0, 120));
        }"""
    )
    assert nameless == []


@pytest.mark.slow
def test_a_viewer_in_a_notebook_keeps_to_itself(viewer):
    page = viewer.page
    page.evaluate(
        """() => {
          view.close();
          document.getElementById("viewer").remove();
          document.body.innerHTML = "<div><div id=cell></div><textarea id=other></textarea></div>";
        }"""
    )
    page.add_script_tag(content=SESSION.replace('"viewer"', '"cell"'))
    viewer.hear(WELCOME | {"schema": scene_schema()})
    viewer.state()
    page.evaluate("window.said = []")
    page.locator("#other").focus()
    page.keyboard.press("f")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("f")
    assert viewer.said("edit") == []
    viewer.press("f")
    assert "camera.from" in viewer.edited()
