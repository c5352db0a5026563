"""What several tests of the console and its page need."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

# Collects the elements that move without a request, in `window.shifted`.
WATCH_SHIFTS = """() => { window.shifted = []; new PerformanceObserver(list => {
  for (const entry of list.getEntries())
    for (const { node } of entry.sources) window.shifted.push(node.id || node.nodeName);
}).observe({ type: 'layout-shift' }); }"""

# Collects the messages that the page sends, in `window.sent`.
WATCH_MESSAGES = """() => {
  const send = WebSocket.prototype.send;
  window.sent = [];
  WebSocket.prototype.send = function (text) {
    window.sent.push(JSON.parse(text));
    return send.call(this, text);
  };
}"""


def stamp_at(index):
    """Of a frame of a recording at 25 Hz, with all its digits."""
    return 1_700_000_000_123_456_789 + index * 40_000_000


def run_apart(coroutine):
    """The result of a coroutine in a thread; tests with a browser keep a loop in this one."""
    with ThreadPoolExecutor(1) as executor:
        return executor.submit(asyncio.run, coroutine).result()
