"""Tests; they do their algebra as the services do, on one thread."""

from wackel_node.algebra import single_threaded

single_threaded()
