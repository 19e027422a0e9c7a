"""``wackel schema``: JSON Schemas of all messages, for readers in other languages."""

import argparse
import inspect
import json
import sys
from pathlib import Path
from typing import Any

import msgspec

from wackel_node.errors import FAILED, OK, NotWritable
from wackel_schemas.keys import QUERIES, ROOT, TOPICS
from wackel_schemas.message import Record

DIALECT = "https://json-schema.org/draft/2020-12/schema"
_WIRE = "A MessagePack map with these names; binary fields are MessagePack bin."


def schemas() -> dict[str, str]:
    """JSON text of the schema of each message, by type name."""
    uses: dict[type[Record], list[str]] = {}
    for topic in TOPICS:
        uses.setdefault(topic.message, []).append(f"Published on {_key(topic.pattern)}.")
    for query in QUERIES:
        uses.setdefault(query.request, []).append(f"Request to {_key(query.pattern)}.")
        uses.setdefault(query.reply, []).append(f"Answer from {_key(query.pattern)}.")
    by_name = sorted(uses.items(), key=lambda item: item[0].__name__)
    return {message.__name__: _schema(message, use) for message, use in by_name}


def _key(pattern: str) -> str:
    return f"{ROOT}/{{robot}}/{pattern}"


def _schema(message: type[Record], use: list[str]) -> str:
    schema = {
        "$schema": DIALECT,
        "title": message.__name__,
        "description": " ".join([_WIRE, *use]),
        **_tidy(msgspec.json.schema(message)),
    }
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def _tidy(node: Any) -> Any:
    """Docstrings without indentation, which Python keeps before 3.13 and removes from then on."""
    match node:
        case dict():
            return {
                key: inspect.cleandoc(value)
                if key == "description" and isinstance(value, str)
                else _tidy(value)
                for key, value in node.items()
            }
        case list():
            return [_tidy(item) for item in node]
        case _:
            return node


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel schema",
        description="JSON Schemas of all messages. Without an option, lists the types, or prints "
        "the schema of one.",
    )
    parser.add_argument("type", nargs="?", help="name of a message type, such as Health")
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--write", type=Path, metavar="DIR", help="write one file for each type")
    group.add_argument(
        "--check", type=Path, metavar="DIR", help="exit 1 if the files there are out of date"
    )
    arguments = parser.parse_args(argv)
    texts = schemas()
    if arguments.write is not None:
        try:
            return _write(arguments.write, texts)
        except OSError as error:
            raise NotWritable(f"{error.filename}: {error.strerror}") from error
    if arguments.check is not None:
        return _check(arguments.check, texts)
    if arguments.type is None:
        print("\n".join(texts))
    elif arguments.type in texts:
        print(texts[arguments.type], end="")
    else:
        parser.error(f"no type {arguments.type!r}; there are {', '.join(texts)}")
    return OK


def _write(directory: Path, texts: dict[str, str]) -> int:
    directory.mkdir(parents=True, exist_ok=True)
    for name in _found(directory).keys() - texts.keys():
        (directory / f"{name}.json").unlink()
    for name, text in texts.items():
        (directory / f"{name}.json").write_text(text, encoding="utf-8")
    return OK


def _found(directory: Path) -> dict[str, str]:
    """Texts of the schemas of messages that are there, by name; other files are not ours."""
    files = [path for path in directory.glob("*.json") if path.is_file()]
    texts = {path.stem: path.read_bytes() for path in files}
    ours = _WIRE.encode()
    return {name: text.decode(errors="replace") for name, text in texts.items() if ours in text}


def _check(directory: Path, texts: dict[str, str]) -> int:
    found = _found(directory)
    stale = sorted(
        name for name in found.keys() | texts.keys() if found.get(name) != texts.get(name)
    )
    if not stale:
        return OK
    print(
        f"out of date: {', '.join(stale)}; renew with `wackel schema --write {directory}`",
        file=sys.stderr,
    )
    return FAILED


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
