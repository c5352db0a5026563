"""Prefetching in a thread."""

import threading

import pytest

from pf_tracker_ros.footage.prefetch import Prefetch


def test_items_come_in_order_and_no_more_is_read_ahead_than_the_depth():
    read = []

    def source():
        for number in range(100):
            read.append(number)
            yield number

    prefetch = Prefetch(source(), depth=3)
    items = iter(prefetch)
    assert [next(items), next(items)] == [0, 1]
    # Two taken, three in the queue, one being read.
    assert len(read) <= 6
    assert list(items) == list(range(2, 100))
    prefetch.close()


def test_an_error_comes_after_the_items_before_it():
    def source():
        yield 1
        yield 2
        raise ValueError("the disk is gone")

    prefetch = Prefetch(source())
    items = iter(prefetch)
    assert [next(items), next(items)] == [1, 2]
    with pytest.raises(ValueError, match="the disk is gone"):
        next(items)
    prefetch.close()


@pytest.mark.parametrize("taken", [0, 1, 5])
def test_the_source_is_closed_by_the_thread_that_read_it(taken):
    threads = []

    def source():
        threads.append(threading.current_thread())
        try:
            yield from range(1000)
        finally:
            threads.append(threading.current_thread())

    prefetch = Prefetch(source(), depth=2)
    items = iter(prefetch)
    for _ in range(taken):
        next(items)
    prefetch.close()
    opened_by, closed_by = threads
    assert opened_by is closed_by is not threading.main_thread()
    assert not opened_by.is_alive()
