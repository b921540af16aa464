"""How the package is built: folders and floors without circles, as CONTRIBUTING.md draws them."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "tfm_cl"

MOST_IN_ROOT = 12
"""Modules in the package's root: what everything may use."""

MOST_FLOORS = 10
"""Of the whole package, as `FLOORS` counts them."""

FLOORS = {
    "": 2,
    "files": 4,
    "maps/bases": 4,
    "scene": 7,
    "device": 6,
    "plan": 8,
    "maps": 7,
    "reference": 10,
    "render": 9,
    "jobs": 6,
    "page": 1,
    "sweep": 9,
    "sequence": 9,
    "bake": 8,
    "viewer": 10,
    "cli": 10,
}
"""Most modules on top of each other down from one of the folder, each importing the next when it is loaded or
inside its functions. What is imported for annotations alone is no floor: it is not there when code runs."""

FLOORS_WITH_TYPES = 16
"""The same of the whole package where annotations count too. All caps may fall."""


def _modules() -> dict[str, Path]:
    """Every module, by its name within the package."""
    found = {}
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = _modules()


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _nodes(tree: ast.AST, *, types: bool) -> Iterator[ast.AST]:
    """All statements of a tree; without ``types`` none of ``if TYPE_CHECKING:``, but of its ``else``."""
    yield tree
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.expr):
            continue
        if not types and isinstance(child, ast.If) and ast.unparse(child.test).endswith("TYPE_CHECKING"):
            for node in child.orelse:
                yield from _nodes(node, types=types)
        else:
            yield from _nodes(child, types=types)


def _imports(name: str, *, types: bool = True) -> set[str]:
    """Modules of the package that one imports, anywhere in its text: in functions too, and for ``types``."""
    found = set()
    for node in _nodes(_tree(MODULES[name]), types=types):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative imports hide where they lead"
            parts = (node.module or "").split(".")
            if parts[0] == "tfm_cl":
                base = ".".join(parts[1:])
                inner = (f"{base}.{alias.name}".lstrip(".") for alias in node.names)
                found |= {module if module in MODULES else base for module in inner}
        elif isinstance(node, ast.Import):
            inner = (alias.name for alias in node.names if alias.name.startswith("tfm_cl."))
            found |= {module.removeprefix("tfm_cl.") for module in inner}
    return found - {name, ""}


@cache
def imports(*, types: bool = True) -> dict[str, set[str]]:
    """Of each module; without ``types`` those that are there when code runs."""
    # The root's __init__ names the whole package, for those who use it.
    return {name: _imports(name, types=types) if name else set() for name in MODULES}


@cache
def reachable(name: str) -> frozenset[str]:
    """All that a module leads to."""
    seen, waiting = set(), [name]
    while waiting:
        for other in imports()[waiting.pop()] - seen:
            seen.add(other)
            waiting.append(other)
    return frozenset(seen)


def circle_of(name: str) -> frozenset[str]:
    """The modules that one imports, however indirectly, and that import it; itself too."""
    return frozenset({name, *(other for other in reachable(name) if name in reachable(other))})


def floors(found: dict[str, set[str]]) -> dict[str, int]:
    """Modules on top of each other, down from each; circles are refused by a test of their own."""

    @cache
    def floor(name: str) -> int:
        return 1 + max((floor(other) for other in found[name] - circle_of(name)), default=0)

    return {name: floor(name) for name in found if name not in ("", "__main__")}


def folder_of(name: str) -> str:
    """``scene`` of ``scene.lights.spot``; empty in the root. The bases know nothing of maps."""
    if name.startswith("maps.bases"):
        return "maps/bases"
    first = name.split(".", maxsplit=1)[0]
    return first if (PACKAGE / first).is_dir() else ""


def folder_imports() -> set[tuple[str, str]]:
    """Which folder imports which; the root is none."""
    pairs = {(folder_of(name), folder_of(other)) for name, others in imports().items() for other in others}
    return {(one, other) for one, other in pairs if one and other and one != other}


def drawn() -> set[tuple[str, str]]:
    """Arrows of the picture in CONTRIBUTING.md; everything uses the root, which is not drawn."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    picture = re.search(r"```mermaid\n(.*?)```", text, re.DOTALL)
    assert picture, "CONTRIBUTING.md: the picture of the layout is missing"
    return set(re.findall(r"^ *(\S+) --> (\S+)$", picture[1], re.MULTILINE))


def below(folder: str, arrows: set[tuple[str, str]]) -> set[str]:
    """All folders that arrows lead to."""
    found: set[str] = set()
    for one, other in arrows:
        if one == folder:
            found |= {other} | below(other, arrows)
    return found


def test_the_root_holds_few_modules():
    assert len(list(PACKAGE.glob("*.py"))) <= MOST_IN_ROOT
    leading = {
        name: others for name, others in imports().items() if not folder_of(name) and name != "__main__"
    }
    for name, others in leading.items():
        assert not any(map(folder_of, others)), f"{name} imports {others}: the root is what all build on"


def test_no_module_is_its_own_foundation():
    assert not {circle for circle in map(circle_of, MODULES) if len(circle) > 1}


def test_the_picture_shows_what_imports_what():
    arrows, real = drawn(), folder_imports()
    for one, other in sorted(real):
        assert other in below(one, arrows), f"{one} imports {other}, which CONTRIBUTING.md does not draw"
    for arrow in sorted(arrows):
        assert arrow in real, f"CONTRIBUTING.md draws {arrow}, which no module imports"
        others = arrows - {arrow}
        assert arrow[1] not in below(arrow[0], others), f"{arrow} is drawn, but other arrows say it already"


def test_folders_lie_on_top_of_each_other():
    arrows = drawn()
    assert {folder for arrow in arrows for folder in arrow} == {folder for folder in FLOORS if folder}
    for folder in FLOORS:
        assert folder not in below(folder, arrows)  # a circle would not end


def test_no_folder_rises_higher():
    found: dict[str, int] = {}
    for name, height in floors(imports(types=False)).items():
        found[folder_of(name)] = max(found.get(folder_of(name), 0), height)
    assert found.keys() == FLOORS.keys()
    assert {folder: height for folder, height in found.items() if height > FLOORS[folder]} == {}
    assert max(found.values()) <= MOST_FLOORS


def test_annotations_do_not_rise_higher():
    assert max(floors(imports()).values()) <= FLOORS_WITH_TYPES


def test_types_are_no_way_around_the_floors(tmp_path, monkeypatch):
    """What only annotates is told apart from what is imported in a function or beside it."""
    text = """
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    from tfm_cl.errors import TfmError
else:
    from tfm_cl.model import Model
def late():
    from tfm_cl.limits import LARGEST_COLOUR
"""
    (tmp_path / "made_up.py").write_text(text)
    monkeypatch.setitem(MODULES, "made_up", tmp_path / "made_up.py")
    assert _imports("made_up") == {"errors", "model", "limits"}
    assert _imports("made_up", types=False) == {"model", "limits"}
