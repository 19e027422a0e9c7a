"""What is wrong with a configuration tree, in one line: key, what stands there, what is allowed.

msgspec names neither the keys of a mapping nor the allowed values, so the tree is walked along the
types themselves. A type may carry ``Meta(extra=...)`` with the ``values`` that are allowed, with
``words`` for what is, or with the ``unit`` of a number that has limits.
"""

import difflib
import re
from collections.abc import Iterable

from msgspec import inspect

_LARGEST = 1e18  # no quantity of a robot is larger, and msgspec's integers end soon after
_LONGEST = 60  # characters of a value that are worth repeating


def first_problem(tree: object, wanted: type) -> str | None:
    """The first thing in ``tree`` that does not fit the type; ``None`` if all of it fits."""
    return _problem(tree, inspect.type_info(wanted), "")


def _problem(value: object, wanted: inspect.Type, path: str) -> str | None:
    permitted = _permitted(wanted)
    extra = {}
    if isinstance(wanted, inspect.Metadata):
        extra, wanted = wanted.extra or {}, wanted.type
    if isinstance(wanted, inspect.UnionType):
        return _problem(value, _not_none(wanted), path)
    if isinstance(wanted, inspect.StructType) and isinstance(value, dict):
        return _struct_problem(value, wanted, path)
    if isinstance(wanted, inspect.DictType) and isinstance(value, dict):
        return _first(
            _problem(item, wanted.value_type, _join(path, key))
            if _problem(key, wanted.key_type, key) is None
            else f"{_join(path, key)}: {_permitted(wanted.key_type)}"
            for key, item in value.items()
        )
    if isinstance(wanted, inspect.ListType) and isinstance(value, list):
        return _first(
            _problem(item, wanted.item_type, f"{path}[{i}]") for i, item in enumerate(value)
        )
    if "values" in extra and value not in extra["values"]:
        return f"{path} = {_shown(value)}: {permitted}"
    if not _fits(value, wanted):
        return f"{path} = {_shown(value)}: {permitted}{_limit(value, wanted)}"
    return None


def _struct_problem(table: dict[str, object], wanted: inspect.StructType, path: str) -> str | None:
    fields = {field.encode_name: field for field in wanted.fields}
    for key in table:
        if key not in fields:
            near = difflib.get_close_matches(key, fields, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(fields)}"
            return f"{_join(path, key)}: unknown key; {hint}"
    for name, field in fields.items():
        if field.required and name not in table:
            return f"{_join(path, name)} is missing: {_permitted(field.type)}"
    return _first(_problem(table[n], fields[n].type, _join(path, n)) for n in table)


def _first(problems: Iterable[str | None]) -> str | None:
    return next((problem for problem in problems if problem), None)


def _fits(value: object, wanted: inspect.Type) -> bool:
    match wanted:
        case inspect.LiteralType():
            return value in wanted.values
        case inspect.BoolType():
            return isinstance(value, bool)
        case inspect.IntType():
            return isinstance(value, int) and _within(value, wanted)
        case inspect.FloatType():
            return isinstance(value, int | float) and _within(value, wanted)
        case inspect.StrType():
            pattern = wanted.pattern
            return isinstance(value, str) and (pattern is None or bool(re.search(pattern, value)))
    return False


def _within(value: float, wanted: inspect.IntType | inspect.FloatType) -> bool:
    return (
        not isinstance(value, bool)
        and abs(value) < _LARGEST  # also refuses inf and nan
        and (wanted.ge is None or value >= wanted.ge)
        and (wanted.gt is None or value > wanted.gt)
        and (wanted.le is None or value <= wanted.le)
        and (wanted.lt is None or value < wanted.lt)
    )


def _permitted(wanted: inspect.Type) -> str:
    """What may stand in a place, in words."""
    match wanted:
        case inspect.Metadata(extra={"values": values}):
            return _alternatives(values)
        case inspect.Metadata(extra={"words": words}):
            return f"allowed is {words}"
        case inspect.Metadata(extra={"unit": unit}):
            return f"{_permitted(wanted.type)} {unit}"
        case inspect.Metadata():
            return _permitted(wanted.type)
        case inspect.UnionType():
            return _permitted(_not_none(wanted))
        case inspect.LiteralType():
            return _alternatives(wanted.values)
        case inspect.BoolType():
            return "allowed are true and false"
        case inspect.IntType():
            return f"allowed is a whole number{_range(wanted)}"
        case inspect.FloatType():
            return f"allowed is a number{_range(wanted)}"
        case inspect.StrType():
            return "allowed is a text in quotes"
        case inspect.ListType():
            return "allowed is a list"
        case _:
            return "allowed is a table"


def _not_none(wanted: inspect.UnionType) -> inspect.Type:
    """The type that may be absent; TOML cannot write None."""
    return next(t for t in wanted.types if not isinstance(t, inspect.NoneType))


def _range(wanted: inspect.IntType | inspect.FloatType) -> str:
    if wanted.le is not None:
        low = f"{wanted.ge:g}" if wanted.ge is not None else f"above {wanted.gt:g}"
        return f", {low} … {wanted.le:g}"
    if wanted.ge is not None:
        return f" from {wanted.ge:g} up"
    return f" greater than {wanted.gt:g}" if wanted.gt is not None else ""


def _limit(value: object, wanted: inspect.Type) -> str:
    """What to add for a number that only is too large, where its type names no largest."""
    number = isinstance(wanted, inspect.IntType | inspect.FloatType) and wanted.le is None
    if number and isinstance(value, int | float) and abs(value) >= _LARGEST:
        return f", of a size below {_LARGEST:g}"
    return ""


def _alternatives(values: Iterable[object]) -> str:
    return f"allowed are {', '.join(map(_shown, values))}"


def _shown(value: object) -> str:
    """A value as the file has it, on one line and no longer than a line."""
    match value:
        case dict():
            return "a table"
        case list():
            return "a list"
        case bool():
            return str(value).lower()
        case _:
            text = repr(value) if isinstance(value, str) else str(value)
            return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _join(path: str, key: str) -> str:
    part = key if re.fullmatch(r"[A-Za-z0-9_-]{1,40}", key) else _shown(key)
    return f"{path}.{part}" if path else part
