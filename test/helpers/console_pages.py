"""What several tests of the console's page need."""

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
