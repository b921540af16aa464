"""The widget in a real browser, with a kernel that only the test answers for."""

import json
import sys
from pathlib import Path

import pytest
from browser_pages import fetched, until, watched

pytest.importorskip("anywidget")
from tfm_cl.viewer.cell import Shown, Viewer

VS_CODE = Path(__file__).parents[2] / ".venv-vscode" / "package" / "dist" / "ipywidgets.js"
"""What VS Code's extension for notebooks loads into the frame of their outputs: `make oracles` fetches it."""

KERNEL = """async (source) => {
  const module = await import(URL.createObjectURL(new Blob([source], { type: "text/javascript" })));
  const listeners = new Map();
  window.said = [];
  window.model = {
    get: () => "400px",
    on: (name, listener) => listeners.set(name, listener),
    off: (name) => listeners.delete(name),
    send: (content, callbacks, buffers = []) =>
      said.push({ ...content, bytes: buffers.map(({ byteLength }) => byteLength) }),
  };
  window.hear = (content, buffers = []) =>
    listeners.get("msg:custom")({ view: said[0].view, ...content }, buffers);
  window.keys = [];
  document.addEventListener("keydown", ({ key }) => keys.push(key));
  window.close = module.default.render({ model, el: document.getElementById("cell") });
}"""

IN_VS_CODE = """async ([renderer, anywidget, widgets]) => {
  const asModule = (source) => import(URL.createObjectURL(new Blob([source], { type: "text/javascript" })));
  const known = {};
  window.define = (...given) => {
    const make = given.pop();
    const name = typeof given[0] === "string" ? given.shift() : "anywidget";
    known[name] = make(...(given[0] ?? []).map((need) => known[need]));
  };
  window.requirejs = ([name], done) => done(known[name]);
  (await asModule(renderer)).activate();
  vscIPyWidgets8.load();
  await asModule(anywidget);
  let open = null;
  const unheard = { connect() {}, disconnect() {} };
  const kernel = {
    statusChanged: unheard, connectionStatusChanged: unheard, iopubMessage: unheard,
    registerCommTarget: (name, opened) => { open = opened; },
    removeCommTarget() {},
    requestCommInfo: async () => ({ content: { comms: {} } }),
  };
  const scripts = {
    widgetsRegisteredInRequireJs: new Set(["anywidget"]),
    loadWidgetScript() {}, successHandler() {}, errorHandler: console.error,
  };
  const manager = new vscIPyWidgets.WidgetManager(kernel, undefined, scripts, () => {});
  window.said = [];
  for (const { id, state } of widgets) {
    const send = ({ content }, metadata, buffers = []) => {
      if (content) said.push({ ...content, bytes: buffers.map(({ byteLength }) => byteLength) });
      return {};
    };
    const comm = { commId: id, targetName: "jupyter.widget", send };
    const message = (data, buffers = []) =>
      ({ content: { comm_id: id, data }, metadata: { version: "2.1.0" }, buffers });
    window.hear = (content, buffers) =>
      comm.onMsg(message({ method: "custom", content: { view: said[0].view, ...content } }, buffers));
    open(comm, message({ state, buffer_paths: [] }));
  }
  const el = document.getElementById("cell");
  const view = await manager.create_view(await manager.get_model(widgets.at(-1).id), { el });
  await manager.display_view({}, view, { node: el });
}"""

PICTURE = """async () => {
  const canvas = Object.assign(document.createElement("canvas"), { width: 32, height: 18 });
  Object.assign(canvas.getContext("2d"), { fillStyle: "rgb(200, 100, 50)" }).fillRect(0, 0, 32, 18);
  const blob = await new Promise((done) => canvas.toBlob(done, "image/png"));
  const bytes = new Uint8Array(await blob.arrayBuffer());
  const header = { type: "picture", picture: 7, which: "a", revision: 1, quality: "full" };
  Object.assign(header, { width: 32, height: 18, mime: "image/png", gain: 1 });
  const told = new TextEncoder().encode(JSON.stringify(header));
  const size = 4 + told.length + bytes.length;
  // As kernels send it: a part of what came.
  const message = new DataView(new ArrayBuffer(16 + size + 5), 16, size);
  message.setUint32(0, told.length, true);
  new Uint8Array(message.buffer).set(told, 20);
  new Uint8Array(message.buffer).set(bytes, 20 + told.length);
  hear({}, [message]);
}"""

DROP = """(size) => {
  const transfer = new DataTransfer();
  transfer.items.add(new File([new Uint8Array(size)], "cloud.vdb"));
  for (const name of ["dragenter", "dragover", "drop"]) {
    const event = new DragEvent(name, { dataTransfer: transfer, bubbles: true, cancelable: true });
    document.querySelector(".stage").dispatchEvent(event);
  }
}"""

WELCOME = {
    "type": "welcome",
    "version": "0",
    "schema": {},
    "layers": [],
    "views": [],
    "presets": [],
    "folder": "/folder",
    "most_upload": 1 << 30,
    "shared": False,
    "can": {"open": True, "save": True},
}


@pytest.fixture
def cell(browser):
    """A cell in which the widget is shown; nothing may complain."""
    seen = watched(browser)
    page = seen.page
    page.set_content("<!doctype html><body data-jp-theme-light=false><div id=cell></div>")
    page.add_style_tag(content=Viewer._css)
    page.evaluate(KERNEL, Viewer._esm)
    yield page
    seen.context.close()
    assert seen.complaints == []


def hear(page, message):
    page.evaluate("(message) => hear({ text: JSON.stringify(message) })", message)


PIXEL = "[...document.querySelector('.picture').getContext('2d').getImageData(5, 5, 1, 1).data.slice(0, 3)]"


@pytest.mark.slow
def test_the_page_lives_in_a_cell(cell):
    assert cell.evaluate("said[0].here && /^[0-9a-f]{32}$/.test(said[0].view)")
    assert cell.locator("#cell .tfm-viewer").bounding_box()["height"] == 400
    assert cell.locator(".tfm-viewer").get_attribute("data-theme") == "dark"  # as the notebook's
    hear(cell, WELCOME)
    cell.evaluate(PICTURE)
    until(cell, "said.some(({ said }) => said === JSON.stringify({ type: 'seen', picture: 7 }))")
    assert cell.evaluate(PIXEL) == [200, 100, 50]

    cell.locator(".stage").press("g")
    assert cell.evaluate("keys") == []  # the notebook has keys of its own
    cell.evaluate("close()")
    assert cell.evaluate("said.at(-1).gone")


@pytest.mark.slow
def test_a_kernel_that_does_not_answer_is_told_of(cell):
    hear(cell, WELCOME)
    cell.evaluate("() => hear({ here: true })")
    assert "the kernel does not answer" not in cell.locator(".tfm-viewer").inner_text()
    cell.evaluate(
        "() => { const { view } = said[0]; hear({ view: 'another' }); close(); model.view = view; }"
    )
    cell.evaluate(KERNEL, Viewer._esm)  # and nothing answers

    cell.get_by_text("the kernel does not answer").first.wait_for()
    cell.evaluate("() => hear({ here: true })")
    until(cell, "!document.querySelector('.tfm-viewer').innerText.includes('the kernel does not answer')")


@pytest.mark.slow
def test_a_file_is_sent_in_parts_and_opened(cell):
    hear(cell, WELCOME)
    cell.evaluate(DROP, (1 << 20) + 5)
    for number, (first, last, size) in enumerate([(True, False, 1 << 20), (False, True, 5)]):
        until(cell, "(number) => said.filter(({ upload }) => upload).length > number", number)
        part = cell.evaluate("(number) => said.filter(({ upload }) => upload)[number]", number)
        assert (part["upload"], part["isFirst"], part["isLast"]) == ("cloud.vdb", first, last)
        assert part["bytes"] == [size]
        cell.evaluate("(taken) => hear({ taken })", {"path": "cloud-2.vdb"} if last else {})

    until(cell, "said.some(({ said }) => said === JSON.stringify({ type: 'open', path: 'cloud-2.vdb' }))")


@pytest.mark.slow
def test_vs_codes_renderer_shows_it(browser):
    if not VS_CODE.is_file():
        pytest.skip("no renderer of VS Code's; `make oracles` fetches it where there is npm")
    anywidget = Path(sys.prefix) / "share/jupyter/nbextensions/anywidget/index.js"
    seen = watched(browser)
    page = seen.page
    html = "<!doctype html><body data-vscode-theme-kind=vscode-light><div id=cell></div>"
    page.route("**/*", lambda route: route.fulfill(body=html, content_type="text/html"))
    page.goto("http://outputs.invalid/")  # its modules want an address
    with Viewer(Shown(None, None, None, lambda: None), "400px") as viewer:
        widgets = [{"id": each.model_id, "state": each.get_state()} for each in (viewer.layout, viewer)]
    page.evaluate(IN_VS_CODE, [VS_CODE.read_text(), anywidget.read_text(), json.loads(json.dumps(widgets))])

    until(page, "said.length > 0")
    assert page.locator(".tfm-viewer").get_attribute("data-theme") == "light"
    hear(page, WELCOME)
    page.evaluate(PICTURE)
    until(page, "said.some(({ said }) => said === JSON.stringify({ type: 'seen', picture: 7 }))")
    assert page.evaluate(PIXEL) == [200, 100, 50]
    page.evaluate(DROP, 5)
    until(page, "said.some(({ upload, bytes }) => upload === 'cloud.vdb' && bytes[0] === 5)")
    assert fetched(seen) == ["http://outputs.invalid/"]
    seen.context.close()


@pytest.mark.slow
def test_dialogs_are_where_the_viewer_is_seen(browser):
    """VS Code's frame of outputs is thousands of pixels higher than its window, which shows a part of it."""
    seen = watched(browser)
    frame = "position: absolute; top: -5000px; width: 100%; height: 12000px"
    seen.page.set_content(
        f"<!doctype html><body style='height: 800px; overflow: hidden'><iframe srcdoc='<!doctype html>"
        f"<div id=cell style=\"margin-top: 5100px\"></div>' style='{frame}'></iframe>"
    )
    cell = seen.page.frames[1]
    cell.wait_for_selector("#cell", state="attached")
    cell.add_style_tag(content=Viewer._css)
    cell.evaluate(KERNEL, Viewer._esm)
    hear(cell, WELCOME)

    around = cell.locator(".tfm-viewer").bounding_box()
    for name in ("Keys and mouse", "Open"):
        cell.get_by_role("button", name=name).click()
        cell.wait_for_selector("dialog[open]")
        box = cell.locator("dialog[open]").bounding_box()
        assert box["y"] + box["height"] / 2 == pytest.approx(around["y"] + around["height"] / 2, abs=1)
        assert around["y"] <= box["y"], "higher than what it is about"
        cell.locator("dialog[open]").press("Escape")
    seen.context.close()
    assert seen.complaints == []
