"""Writing TOML, which the standard library only reads."""

import json
import re
from collections.abc import Iterator, Mapping

Tree = Mapping[str, object]


def toml_text(tree: Tree) -> str:
    """A tree of tables, lists, texts, numbers and switches as TOML.

    ``None``, which TOML does not know, becomes a comment, so that the key can still be seen.
    """
    return "\n".join(_table(tree, "")).lstrip("\n") + "\n"


def _table(tree: Tree, path: str) -> Iterator[str]:
    tables = {key: value for key, value in tree.items() if _is_table(value)}
    for key, value in tree.items():
        if value is None:
            yield f"# {_key(key)} is absent"
        elif key not in tables:
            yield f"{_key(key)} = {_value(value)}"
    for key, value in tables.items():
        inner = f"{path}.{_key(key)}" if path else _key(key)
        if isinstance(value, Mapping):
            yield f"\n[{inner}]"
            yield from _table(value, inner)
        elif isinstance(value, list):
            for item in value:
                yield f"\n[[{inner}]]"
                yield from _table(item, inner)


def _is_table(value: object) -> bool:
    return isinstance(value, Mapping) or (
        isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)
    )


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)


def _value(value: object) -> str:
    # JSON's texts, numbers, lists and switches are TOML's, but for one control character.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
