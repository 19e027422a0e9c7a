"""The journal of a service: which messages it took in, in which order, whatever their numbers."""

from hypothesis import given
from hypothesis import strategies as st

from wackel_node.journal import MOST, Journal
from wackel_schemas import wire
from wackel_schemas.inputs import InputStream
from wackel_schemas.keys import MOST_BYTES
from wackel_schemas.message import Message

NAMES = st.tuples(st.sampled_from(["a", "b", "c"]), st.integers(0, 2), st.integers(0, 5))


def take(journal: Journal, names: list[tuple[str, int, int]]) -> None:
    for key, boot, seq in names:
        journal.take(key, Message(stamp=0, boot=boot, seq=seq))


def test_messages_without_a_gap_are_one_stream() -> None:
    journal = Journal()
    take(journal, [("a", 1, 7), ("b", 2, 0), ("a", 1, 8), ("a", 1, 9)])
    word = journal.word(5)
    assert word is not None
    assert word.stamp == 5
    assert word.streams == [
        InputStream(key="a", boot=1, seq=7),
        InputStream(key="b", boot=2, seq=0),
    ]
    assert word.order == [0, 1, 0, 0]
    assert journal.word(6) is None


@given(st.lists(NAMES, max_size=50))
def test_a_word_names_what_was_taken_in_its_order(names: list[tuple[str, int, int]]) -> None:
    journal = Journal()
    take(journal, names)
    word = journal.word(0)
    told = []
    if word is not None:
        counts = [0] * len(word.streams)
        for index in word.order:
            stream = word.streams[index]
            told.append((stream.key, stream.boot, stream.seq + counts[index]))
            counts[index] += 1
    assert told == names


def test_the_longest_word_of_publishers_that_do_not_number_can_be_sent() -> None:
    journal = Journal()
    while not journal.full:
        take(journal, [("bus/of_a_robot_with_long_names/transaction", 1 << 31, 1 << 40)])
    word = journal.word(1 << 62)
    assert word is not None
    assert len(word.order) == MOST
    assert len(wire.encode(word)) < MOST_BYTES
