"""Signals that a block handles otherwise."""

import os
import signal
import threading

from pf_tracker_ros.signals import handled_signals


def test_a_block_handles_signals_and_what_was_before_is_there_again():
    heard = []
    before = signal.getsignal(signal.SIGTERM)
    with handled_signals({signal.SIGTERM: lambda number, _: heard.append(number)}):
        os.kill(os.getpid(), signal.SIGTERM)
    assert heard == [signal.SIGTERM]
    assert signal.getsignal(signal.SIGTERM) is before


def test_in_another_thread_all_stays_as_it_is():
    found = []

    def look():
        with handled_signals({signal.SIGTERM: signal.SIG_IGN}):
            found.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert found == [signal.getsignal(signal.SIGTERM)]
