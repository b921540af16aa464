"""In which line of a TOML file a key is."""

from __future__ import annotations

import tomllib
from collections import deque
from functools import cached_property
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tree_sitter import Node

    from tfm_cl.errors import Key


class TomlLines:
    """Lines of the keys of a text that is TOML; it is parsed when first asked."""

    def __init__(self, text: str) -> None:
        self._text = text

    def exactly(self, key: Key) -> int | None:
        """Return the line, from 1, of a key; None where the text does not have it."""
        return self._lines.get(key)

    def nearest(self, key: Key) -> int | None:
        """Return the line of a key or, where the text lacks it, of the innermost table that would have it."""
        found = (self._lines.get(key[:length]) for length in range(len(key), 0, -1))
        return next((line for line in found if line is not None), None)

    @cached_property
    def _lines(self) -> dict[Key, int]:
        import tree_sitter_toml  # noqa: PLC0415 - only where something is wrong
        from tree_sitter import Language, Parser  # noqa: PLC0415

        tree = Parser(Language(tree_sitter_toml.language())).parse(self._text.encode())
        lines: dict[Key, int] = {}
        counts: dict[Key, int] = {}
        waiting = deque((node, _table(node, lines, counts)) for node in tree.root_node.named_children)
        while waiting:
            node, base = waiting.popleft()
            line = node.start_point.row + 1
            if node.type == "pair":
                key, value = node.named_children[:2]
                for part in _parts(key):
                    base = (*base, part)
                    lines.setdefault(base, line)
                waiting.append((value, base))
            elif node.type == "array":
                for number, item in enumerate(_without_remarks(node)):
                    lines.setdefault((*base, number), item.start_point.row + 1)
                    waiting.append((item, (*base, number)))
            elif node.type in {"table", "table_array_element", "inline_table"}:
                waiting += ((child, base) for child in node.named_children if child.type == "pair")
        return lines


def _table(node: Node, lines: dict[Key, int], counts: dict[Key, int]) -> Key:
    """Return the key of a table, and keep its line; that of anything else is empty."""
    if node.type not in {"table", "table_array_element"}:
        return ()
    key: Key = ()
    line, parts = node.start_point.row + 1, _parts(node.named_children[0])
    for number, part in enumerate(parts, 1):
        key = (*key, part)
        if node.type == "table_array_element" and number == len(parts):
            counts[key] = counts.get(key, 0) + 1
        lines.setdefault(key, line)
        if key in counts:  # the last table of an array
            key = (*key, counts[key] - 1)
            lines.setdefault(key, line)
    return key


def _without_remarks(node: Node) -> list[Node]:
    return [child for child in node.named_children if child.type != "comment"]


def _parts(node: Node) -> list[str]:
    """Return the parts of a key, dotted and quoted as it may be."""
    table, parts = tomllib.loads(f"{(node.text or b'').decode()} = 0"), []
    while isinstance(table, dict):
        ((part, table),) = table.items()
        parts.append(part)
    return parts
