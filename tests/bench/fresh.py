"""Robots that nobody has seen: each version of the diagnoser is judged by its own.

A seed that has judged once is known, and what it showed may have changed the code. So seeds have in
them a fingerprint of the code: the same code gives the same robots, another gives others.
"""

import ast
import hashlib
from collections.abc import Iterable
from pathlib import Path

_ROOT = Path(__file__).parents[2]
_CODE = (
    "services/wackel_diagnoser",
    "services/wackel_virtual",
    "common/wackel_drive",
    "common/wackel_kinematics",
    "tests/diagnoser",
    "tests/odometry",
    "common/wackel_node/config_drive.py",
)
_NO_PART = (
    *("__main__.py", "service.py", "port.py", "scenario.py", "coupled_drive.py"),
    *("display.py", "steps.py", "explain.py", "isolability.py", "test_*.py", "conftest.py"),
)
"""Of what drives a robot here and decides what is wrong with it."""


def version(*more: str) -> str:
    """The fingerprint of the code that simulated robots are driven and diagnosed with, and of
    more directories."""
    return fingerprint(_ROOT / name for name in (*_CODE, *more))


def fingerprint(places: Iterable[Path]) -> str:
    """Of the code in files and directories; its comments and docstrings do not count."""
    code = hashlib.sha256()
    for place in places:
        for path in [place] if place.is_file() else sorted(place.glob("*.py")):
            if any(map(path.match, _NO_PART)):
                continue
            tree = ast.parse(path.read_text())
            for node in ast.walk(tree):
                if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                    node.value.value = ""
            code.update(ast.dump(tree).encode())
    return code.hexdigest()[:16]
