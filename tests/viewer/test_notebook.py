"""The example notebook, run by a kernel, and the messages of its widget."""

import json
import time
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs" / "examples" / "viewer.ipynb"
SECONDS = 300
"""Until something that should happen counts as missing: kernels may have to be compiled first."""
VIEW = "0" * 32


class FrontEnd:
    """The messages of a widget on the side of the page."""

    def __init__(self, client):
        self.client, self.comm, self.notices, self.pictures = client, None, [], []

    def say(self, **content):
        data = {"method": "custom", "content": {"view": VIEW, **content}}
        message = self.client.session.msg("comm_msg", {"comm_id": self.comm, "data": data})
        self.client.shell_channel.send(message)

    def told(self, condition):
        """Read messages until a condition holds."""
        deadline = time.monotonic() + SECONDS
        while not condition():
            assert time.monotonic() < deadline, self.notices
            if self.client.iopub_channel.msg_ready():
                self._hear(self.client.get_iopub_msg())
            else:
                time.sleep(0.01)

    def full(self, revision):
        """Whether the full picture of a revision has come."""
        return any(one["revision"] == revision and one["quality"] == "full" for one, _ in self.pictures)

    def _hear(self, message):
        content = message["content"]
        data = content.get("data", {})
        if message["msg_type"] == "comm_open" and data["state"].get("_anywidget_id"):
            self.comm = content["comm_id"]
        elif message["msg_type"] == "comm_msg" and content["comm_id"] == self.comm:
            said = data.get("content", {})
            if "text" in said:
                self.notices.append(json.loads(said["text"]))
            for buffer in message["buffers"]:
                length = int.from_bytes(buffer[:4], "little")
                header = json.loads(bytes(buffer[4 : 4 + length]))
                self.pictures.append((header, bytes(buffer[4 + length :])))
                self.say(said=json.dumps({"type": "seen", "picture": header["picture"]}))

    def states(self):
        return [notice for notice in self.notices if notice["type"] == "state"]


@pytest.fixture
def notebook():
    return pytest.importorskip("nbformat").read(NOTEBOOK, 4)


def test_the_example_is_kept_without_what_it_showed(notebook):
    pytest.importorskip("nbformat").validate(notebook)
    assert [cell for cell in notebook.cells if cell.get("outputs") or cell.get("execution_count")] == []


@pytest.mark.slow
def test_the_example_runs_and_its_viewer_renders(notebook, tmp_path):
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    cells = {cell.id: cell for cell in notebook.cells}
    at = {cell.id: index for index, cell in enumerate(notebook.cells)}
    kernel = nbclient.NotebookClient(
        notebook, timeout=SECONDS, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    )
    with kernel.setup_kernel():
        client = kernel.km.blocking_client()
        client.start_channels()
        page = FrontEnd(client)
        try:
            client.wait_for_ready(timeout=SECONDS)
            for name in ("scene", "view"):
                kernel.execute_cell(cells[name], at[name])
            page.told(lambda: page.comm is not None)
            page.say(here=True)
            page.told(lambda: page.full(1))
            page.say(said=json.dumps({"type": "edit", "changes": {"light.0.intensity": [30.0, 15.0, 5.0]}}))
            page.told(lambda: page.full(2))
            for name in ("edited", "close"):
                kernel.execute_cell(cells[name], at[name])
        finally:
            client.stop_channels()

    (before, picture), (after, coloured) = (
        next(
            pair for pair in page.pictures if (pair[0]["revision"], pair[0]["quality"]) == (revision, "full")
        )
        for revision in (1, 2)
    )
    assert {notice["type"] for notice in page.notices} >= {"welcome", "state", "cost"}
    assert (before["width"], before["height"]) == (after["width"], after["height"]) == (480, 320)
    assert picture.startswith(b"\x89PNG")
    assert picture != coloured
    assert [cost["made"] for cost in page.notices if cost["type"] == "cost"][-1].get("map", 0) == 0
    assert "application/vnd.jupyter.widget-view+json" in cells["view"].outputs[0]["data"]
    assert "image/png" in cells["edited"].outputs[0]["data"]
    assert list(tmp_path.iterdir()) == []
