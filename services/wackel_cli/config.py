"""``wackel config``: checks a robot.toml and prints what is in force, with every default."""

import argparse
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from typing import Any, get_args, get_origin, get_type_hints

import msgspec

from wackel_node.arguments import ELSE_DEFAULTS, add_config_first, config_of
from wackel_node.config import RobotConfig, dump
from wackel_node.config_types import Section
from wackel_node.errors import OK

_WIDTH = 80
_INDENT = 24  # the longest name and a gap


def main(argv: list[str]) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="wackel config",
        description="Checks a configuration and prints it with all defaults written out, as TOML "
        "that may be saved and edited. A mistake is told in one line, with exit code 2.",
    )
    add_config_first(parser, ELSE_DEFAULTS)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print JSON instead of TOML")
    form.add_argument("--explain", action="store_true", help="print what each setting means")
    arguments = parser.parse_args(argv)
    config = config_of(arguments)
    if arguments.explain:
        print("\n".join(explanation(RobotConfig)).lstrip("\n"))
    elif arguments.json:
        print(msgspec.json.format(msgspec.json.encode(config)).decode())
    else:
        print(dump(config), end="")
    return OK


def explanation(section: type[Section], path: str = "") -> Iterator[str]:
    """Every setting of a section and of those in it: name, meaning, default."""
    texts = _attributes(section)
    hints = get_type_hints(section)
    inner: list[tuple[type[Section], str]] = []
    for field in msgspec.structs.fields(section):
        found = list(_sections(hints[field.name], f"{path}.{field.name}" if path else field.name))
        if found:
            inner += found
            continue
        default = "" if field.required else f" (default: {_as_toml(field)})"
        yield textwrap.fill(
            texts[field.name] + default,
            _WIDTH,
            initial_indent=f"  {field.name}".ljust(_INDENT),
            subsequent_indent=" " * _INDENT,
        )
    for kind, where in inner:
        name = where.removesuffix("[]")
        first = inspect.cleandoc(kind.__doc__ or "").partition("\n")[0]
        yield f"\n[{name}]" if name == where else f"\n[[{name}]]"
        yield textwrap.fill(first.replace("``", ""), _WIDTH)
        yield from explanation(kind, name)


def _sections(hint: Any, path: str) -> Iterator[tuple[type[Section], str]]:
    """The sections that a setting consists of, and where they stand in a file."""
    origin = get_origin(hint)
    if isinstance(hint, type) and issubclass(hint, Section):
        yield hint, path
    elif origin is dict:
        yield from _sections(get_args(hint)[1], f"{path}.NAME")
    elif origin is list:
        yield from _sections(get_args(hint)[0], f"{path}[]")
    else:
        for argument in get_args(hint):
            yield from _sections(argument, path)


def _attributes(section: type[Section]) -> dict[str, str]:
    """Names and texts under ``Attributes:`` in the docstring."""
    block = inspect.cleandoc(section.__doc__ or "").partition("Attributes:\n")[2]
    texts: dict[str, str] = {}
    for entry in re.split(r"\n(?=    \S)", block):
        names, _, text = entry.partition(":")
        for name in names.split(","):
            texts[name.strip()] = " ".join(text.replace("``", "").split())
    return texts


def _as_toml(field: msgspec.structs.FieldInfo) -> str:
    value = field.default
    if value is msgspec.NODEFAULT:
        value = field.default_factory() if callable(field.default_factory) else ""
    return "absent" if value is None else msgspec.json.encode(value).decode()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
