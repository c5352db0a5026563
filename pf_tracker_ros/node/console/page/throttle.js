// Calls a function with the newest values, at most once per interval in milliseconds, and after the last ones.
export function throttle(interval, call) {
  let called = -Infinity, later = null, newest = [];
  const now = () => {
    clearTimeout(later);
    [later, called] = [null, performance.now()];
    call(...newest);
  };
  return (...values) => {
    newest = values;
    if (performance.now() - called >= interval) now();
    else later ??= setTimeout(now, 1.25 * interval);  // after the next values, if they come often
  };
}
