// The server's clock, by which sessions are told; that of a browser may be hours off.

const LEAST = 2_000; // ms: the server tells whole seconds, and its answer takes a while

let ahead = 0; // ms that the server's clock is before the browser's

/** Take the `Date` that an answer was just sent with, if any. */
export function heard(date) {
  const told = Date.parse(date) + 500 - Date.now();
  if (Math.abs(told - ahead) > LEAST) ahead = told;
}

/** The time at the server (ms). */
export function now() {
  return Date.now() + ahead;
}
