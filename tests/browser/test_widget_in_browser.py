"""The widget in a real browser, with a kernel that only the test answers for."""

import pytest
from browser_pages import until, watched

pytest.importorskip("anywidget")
from tfm_cl.viewer.cell import Viewer

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


@pytest.mark.slow
def test_the_page_lives_in_a_cell(cell):
    assert cell.evaluate("said[0].here && /^[0-9a-f]{32}$/.test(said[0].view)")
    assert cell.locator("#cell .tfm-viewer").bounding_box()["height"] == 400
    assert cell.locator(".tfm-viewer").get_attribute("data-theme") == "dark"  # as the notebook's
    hear(cell, WELCOME)
    cell.evaluate(PICTURE)
    until(cell, "said.some(({ said }) => said === JSON.stringify({ type: 'seen', picture: 7 }))")
    pixel = (
        "[...document.querySelector('.picture').getContext('2d').getImageData(5, 5, 1, 1).data.slice(0, 3)]"
    )
    assert cell.evaluate(pixel) == [200, 100, 50]

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
