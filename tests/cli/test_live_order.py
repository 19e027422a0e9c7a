"""A recording in the order of the live service, whatever the recorder and the service missed."""

from collections.abc import Iterable
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st

from wackel_cli.live_order import BELATED_NS, SILENCE_NS, Input, LiveOrder, Restart
from wackel_node.journal import Journal
from wackel_schemas.inputs import Inputs, InputStream
from wackel_schemas.message import Message

MS = 1_000_000


def input_of(key: str, seq: int, at_ms: int, boot: int = 1) -> Input:
    return Input(key, Message(stamp=0, boot=boot, seq=seq), at_ms * MS)


def names(items: Iterable[Input | Restart]) -> list[tuple[str, int] | None]:
    return [None if isinstance(i, Restart) else (i.key, i.message.seq) for i in items]


def word(seq: int, *taken: tuple[str, int], boot: int = 9) -> Inputs:
    journal = Journal()
    for key, number in taken:
        journal.take(key, Message(stamp=0, boot=1, seq=number))
    inputs = journal.word(0)
    assert inputs is not None
    inputs.boot, inputs.seq = boot, seq
    return inputs


def test_the_word_of_the_live_service_decides() -> None:
    order = LiveOrder()
    for key, seq, at_ms in (("a", 0, 0), ("b", 0, 1), ("a", 1, 2)):
        order.add(input_of(key, seq, at_ms))
    assert names(order.due(3 * MS)) == []
    order.word(word(0, ("b", 0), ("a", 0)), 4 * MS)
    assert names(order.due(4 * MS)) == [("b", 0), ("a", 0)]
    assert names(order.rest()) == [("a", 1)]
    assert (order.unknown, order.passed_over, order.restarts) == (0, 0, 0)


def test_without_a_live_service_the_order_is_that_of_arrival() -> None:
    order = LiveOrder()
    order.add(input_of("a", 5, 0))
    order.add(input_of("b", 0, 10))
    assert names(order.due(SILENCE_NS - MS)) == []
    assert names(order.due(SILENCE_NS)) == [("a", 5)]
    order.add(input_of("follows from the first", 0, 0))
    assert names(order.rest()) == [("follows from the first", 0), ("b", 0)]


def test_what_the_live_service_never_got_is_left_out() -> None:
    order = LiveOrder()
    for seq in range(4):
        order.add(input_of("a", seq, seq))
    order.word(word(0, ("a", 0), ("a", 3)), 5 * MS)
    assert names(order.due(5 * MS)) == [("a", 0), ("a", 3)]
    assert names(order.rest()) == []
    assert order.passed_over == 2


def test_what_the_recorder_never_got_is_waited_for_in_vain() -> None:
    order = LiveOrder()
    order.add(input_of("a", 1, 0))
    order.word(word(0, ("a", 0), ("a", 1)), 1 * MS)
    assert names(order.due(BELATED_NS)) == []
    assert names(order.due(BELATED_NS + 2 * MS)) == [("a", 1)]
    assert order.unknown == 1


def test_a_message_may_be_recorded_after_the_word_of_it() -> None:
    order = LiveOrder()
    order.word(word(0, ("a", 0)), 0)
    assert names(order.due(0)) == []
    order.add(input_of("a", 0, 100))
    assert names(order.due(100 * MS)) == [("a", 0)]
    assert order.unknown == 0


def test_a_restarted_service_forgets_at_its_first_word() -> None:
    order = LiveOrder()
    for seq in range(3):
        order.add(input_of("a", seq, seq))
    order.word(word(0, ("a", 0)), 3 * MS)
    order.word(word(0, ("a", 2), boot=10), 4 * MS)
    assert names(order.due(4 * MS)) == [("a", 0), None, ("a", 2)]
    assert (order.restarts, order.passed_over) == (1, 1)


def test_before_a_lost_word_what_had_arrived_counts() -> None:
    order = LiveOrder()
    for seq in range(4):
        order.add(input_of("a", seq, seq))
    order.word(word(3, ("a", 2), ("a", 3)), 4 * MS)
    assert names(order.due(4 * MS)) == [("a", 0), ("a", 1), ("a", 2), ("a", 3)]
    assert order.lost_words == 1


def test_a_latched_message_may_be_taken_in_twice() -> None:
    order = LiveOrder()
    order.add(input_of("exclusions", 0, 0))
    order.word(word(0, ("exclusions", 0)), MS)
    order.word(word(0, ("exclusions", 0), boot=10), 2 * MS)
    assert names(order.due(2 * MS)) == [("exclusions", 0), None]
    order.add(input_of("exclusions", 1, 3))
    order.word(word(1, ("exclusions", 1), ("exclusions", 1), boot=10), 3 * MS)
    after = 3 * MS + BELATED_NS
    assert names(order.due(after)) == [("exclusions", 1), ("exclusions", 1)]


def test_words_that_make_no_sense_name_nothing() -> None:
    order = LiveOrder()
    order.add(input_of("a", 0, 0))
    stream = InputStream(key="a", boot=1, seq=0)
    order.word(Inputs(stamp=0, boot=9, seq=0, streams=[stream], order=[-1, 1, 7, 0]), MS)
    assert names(order.due(MS)) == [("a", 0)]


@settings(max_examples=200)
@given(seed=st.integers(0, 1 << 32), lost=st.floats(0, 0.3), numbered=st.booleans())
def test_every_message_comes_out_once_at_most_and_as_the_live_service_had_it(
    seed: int, lost: float, numbered: bool
) -> None:
    random = Random(seed)
    journal, order = Journal(), LiveOrder()
    recorded: list[tuple[int, Input | Inputs]] = []
    taken: list[Input] = []
    words = 0
    for n in range(60):
        key = random.choice("ab")
        item = input_of(key, n if numbered else 0, n)
        if random.random() >= lost:
            taken.append(item)
            journal.take(key, item.message)
        recorded.append(((n + random.randint(0, 40)) * MS, item))
        if n % 10 == 9 and (inputs := journal.word(0)) is not None:
            inputs.boot, inputs.seq = 9, words
            words += 1
            recorded.append((n * MS, inputs))
    came: list[Input | Restart] = []
    for at_ns, what in sorted(recorded, key=lambda each: each[0]):
        if isinstance(what, Inputs):
            order.word(what, at_ns)
        else:
            order.add(Input(what.key, what.message, at_ns))
        came += order.due(at_ns)
    came += order.rest()
    # What was lost at the very end looks as if no word of it had come yet.
    keys = [(i.key, i.message.seq) for i in came if isinstance(i, Input)][: len(taken)]
    assert keys == [(i.key, i.message.seq) for i in taken]
    assert len(came) <= 60
