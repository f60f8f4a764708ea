// A client of the server's HTTP API.

const TOKEN = "oracle-token";
const TIMEOUT = 10_000; // ms
const REFRESHES = 10;

/** A request that failed: `status` is HTTP's, or 0 where the server can't be reached. */
export class Problem extends Error {
  constructor(status, message) {
    super(message);
    this.status = status;
  }
}

/** Store a token for this tab, until it is closed. */
export function remember(token) {
  sessionStorage.setItem(TOKEN, token);
}

/** Get a document within `within` ms; `signal` aborts the request. Throws a `Problem`. */
export async function get(path, query = {}, { within = TIMEOUT, signal } = {}) {
  const url = new URL(`api/v1/${path}`, document.baseURI);
  for (const [name, value] of Object.entries(query)) [value].flat().forEach((each) => url.searchParams.append(name, each));
  const token = sessionStorage.getItem(TOKEN);
  const headers = token ? { Authorization: `Bearer ${token}` } : {};
  const ends = AbortSignal.any([AbortSignal.timeout(within), ...(signal ? [signal] : [])]);
  let response, text;
  try {
    response = await fetch(url, { headers, signal: ends, cache: "no-store" });
    text = await response.text();
  } catch {
    throw new Problem(0, "The server can't be reached; trying again.");
  }
  const document_ = parsed(text);
  if (response.ok && document_ instanceof Object && !Array.isArray(document_)) return document_;
  const detail = response.ok ? "The page is not up to date: this answers, but not as an oracle server." : undefined;
  throw new Problem(response.status, detail ?? document_?.detail ?? `The server answered ${response.status}.`);
}

/** Get the items of a list. Throws a `Problem`, or a `TypeError` where the answer is not a list. */
export async function items(path, query = {}) {
  const found = (await get(path, query)).items;
  if (!Array.isArray(found)) throw new TypeError(`${path}: no list`);
  return found;
}

/** Whether to read the history again after a session's state has changed: it follows the state with a delay. */
export class DelayedHistory {
  #known;
  #refreshes = 0;

  /** Whether to read it: until it was read ten times since `value`, a text, changed. */
  isDue(value) {
    if (value !== this.#known) [this.#known, this.#refreshes] = [value, REFRESHES];
    return this.#refreshes > 0;
  }

  /** Count that it was read. */
  wasRead() {
    this.#refreshes -= 1;
  }
}

/** The path of one of a session's documents. */
export function of(session, what = "") {
  return `sessions/${encodeURIComponent(session)}${what && "/"}${what}`;
}

/** Parse JSON with exact integers: those that a double can't represent become BigInt. */
function parsed(text) {
  try {
    return JSON.parse(text, (_, value, context) => {
      const exact = typeof value !== "number" || Number.isSafeInteger(value) || !/^-?\d+$/.test(context?.source ?? "");
      return exact ? value : BigInt(context.source);
    });
  } catch {
    return undefined;
  }
}
