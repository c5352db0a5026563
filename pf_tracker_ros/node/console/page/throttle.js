// Calls a function with the newest of what comes, at most every so many milliseconds, and at last.
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
    else later ??= setTimeout(now, 1.25 * interval);  // after what comes meanwhile, if it comes often
  };
}
