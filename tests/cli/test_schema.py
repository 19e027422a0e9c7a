"""The JSON Schemas that readers in other languages rely on."""

import json
from pathlib import Path

import pytest

from wackel_cli.schema import main, schemas
from wackel_node.errors import Explained
from wackel_schemas.keys import QUERIES, TOPICS

COMMITTED = Path(__file__).parents[2] / "schemas" / "json"


def test_the_committed_schemas_are_those_of_the_types() -> None:
    assert main(["--check", str(COMMITTED)]) == 0


def test_every_message_has_a_schema_that_names_its_keys() -> None:
    texts = schemas()
    for topic in TOPICS:
        description = json.loads(texts[topic.message.__name__])["description"]
        assert f"Published on wackel/{{robot}}/{topic.pattern}." in description
    for query in QUERIES:
        assert query.pattern in json.loads(texts[query.request.__name__])["description"]
        assert query.pattern in json.loads(texts[query.reply.__name__])["description"]


def test_no_schema_depends_on_how_python_keeps_docstrings() -> None:
    assert not any("\\n    Attributes" in text for text in schemas().values())


def test_what_is_out_of_date_missing_or_too_much_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--write", str(tmp_path)]) == 0
    assert main(["--check", str(tmp_path)]) == 0
    (tmp_path / "Health.json").write_text("{}")
    (tmp_path / "BusState.json").unlink()
    gone = (tmp_path / "Odometry.json").read_text()
    (tmp_path / "Gone.json").write_text(gone)
    (tmp_path / "package.json").write_text("{}")
    (tmp_path / "folder.json").mkdir()
    assert main(["--check", str(tmp_path)]) == 1
    assert "out of date: BusState, Gone, Health;" in capsys.readouterr().err
    assert main(["--write", str(tmp_path)]) == 0
    assert main(["--check", str(tmp_path)]) == 0
    assert not (tmp_path / "Gone.json").exists()
    assert (tmp_path / "package.json").read_text() == "{}"  # no message's: somebody else's
    assert main(["--check", str(tmp_path / "nowhere")]) == 1


def test_where_nothing_can_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(Explained, match="file: "):
        main(["--write", str(tmp_path / "file")])


def test_one_type_is_printed_and_a_wrong_name_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["Health"]) == 0
    assert json.loads(capsys.readouterr().out)["title"] == "Health"
    assert main([]) == 0
    assert "Transaction" in capsys.readouterr().out.splitlines()
    with pytest.raises(SystemExit) as exit_:
        main(["Helth"])
    assert exit_.value.code == 2
