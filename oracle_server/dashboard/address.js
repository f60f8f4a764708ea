// Addresses of this page: which view, and of a session which part of its time and which verdict.

let opened = ""; // what the page shows: where the address is another one, that is about to be opened

/** The address of a session: its verdict `n`, and the part of its time from `from` to `to` (ns), where they are given. */
export function at(session, n, { from, to } = {}) {
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries({ from: whole(from), to: whole(to), n })) if (value !== undefined && value !== null) query.set(name, value);
  return `#/sessions/${encodeURIComponent(session)}${query.size ? `?${query}` : ""}`;
}

/** The address of two sessions beside each other, or of one for which another is to be chosen. */
export function compared(session, other) {
  return `#/compare/${encodeURIComponent(session)}${other ? `/${encodeURIComponent(other)}` : ""}`;
}

/** The address of all sessions that are forwarded from a robot. */
export function ofRobot(origin) {
  return `#/?${new URLSearchParams({ q: `origin:${origin}` })}`;
}

/** What the address of the page names, to be opened: `kind` and `id` of a view, `other` where it names two, `n`, `from` and `to`, null where they are not there, and the search `q` of a list and what it shows. */
export function read() {
  opened = location.hash;
  const [path, text] = opened.slice(1).split("?");
  const [, kind, id, other] = path.split("/").map(decoded);
  const query = new URLSearchParams(text);
  const time = (name) => (/^\d{1,19}$/.test(query.get(name) ?? "") ? BigInt(query.get(name)) : null);
  const [from, to] = [time("from"), time("to")];
  const window = from !== null && to !== null && from < to ? { from, to } : { from: null, to: null };
  const search = { q: query.get("q") ?? "", show: query.get("show") ?? "" };
  const n = /^\d{1,15}$/.test(query.get("n") ?? "") ? Number(query.get("n")) || null : null;
  return { kind, id, other, n, ...window, ...search };
}

/** Name what is shown in the address, without a step back in the browser's history; not where another one was chosen. */
export function rename(address) {
  if (location.hash !== opened || opened === address) return;
  history.replaceState(null, "", address);
  opened = location.hash;
}

/** A time as it stands in an address, where none is before 0. */
function whole(time) {
  return typeof time === "bigint" && time < 0n ? 0n : time;
}

function decoded(part) {
  try {
    return decodeURIComponent(part);
  } catch {
    return "";
  }
}
