"""Signal handlers replaced within a block."""

import os
import signal
import threading

from pf_tracker_ros.signals import handled_signals


def test_a_block_replaces_handlers_and_restores_them():
    received = []
    before = signal.getsignal(signal.SIGTERM)
    with handled_signals({signal.SIGTERM: lambda number, _: received.append(number)}):
        os.kill(os.getpid(), signal.SIGTERM)
    assert received == [signal.SIGTERM]
    assert signal.getsignal(signal.SIGTERM) is before


def test_in_another_thread_handlers_stay():
    found = []

    def read():
        with handled_signals({signal.SIGTERM: signal.SIG_IGN}):
            found.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=read)
    thread.start()
    thread.join()
    assert found == [signal.getsignal(signal.SIGTERM)]
