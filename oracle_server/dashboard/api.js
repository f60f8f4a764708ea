// The server's HTTP API: documents as it gives them, and what it refuses.

const TOKEN = "oracle-token";
const PATIENCE = 10_000;
const LOOKS = 10;

/** An answer that is none: `status` is HTTP's, or 0 where no server answered. */
export class Problem extends Error {
  constructor(status, message) {
    super(message);
    this.status = status;
  }
}

/** Keep a token for this tab, until it is closed. */
export function remember(token) {
  sessionStorage.setItem(TOKEN, token);
}

/** A document of the API, waited for so many ms unless `signal` is aborted before. Throws a `Problem`. */
export async function get(path, query = {}, { within = PATIENCE, signal } = {}) {
  const url = new URL(`api/v1/${path}`, document.baseURI);
  for (const [name, value] of Object.entries(query)) url.searchParams.set(name, value);
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

/** The items of a list of the API. Throws a `Problem`, or a `TypeError` where it is no list. */
export async function items(path, query = {}) {
  const found = (await get(path, query)).items;
  if (!Array.isArray(found)) throw new TypeError(`${path}: no list`);
  return found;
}

/** Whether to ask the history for what the state tells of: it is behind, and the longer the slower the disk is. */
export class Behind {
  #known;
  #looks = 0;

  /** Whether `value`, as text, has changed within the last ten looks. */
  changed(value) {
    if (value !== this.#known) [this.#known, this.#looks] = [value, LOOKS];
    return this.#looks > 0;
  }

  /** The history was asked, and has answered. */
  looked() {
    this.#looks -= 1;
  }
}

/** The path of one of a session's documents. */
export function of(session, what = "") {
  return `sessions/${encodeURIComponent(session)}${what && "/"}${what}`;
}

/** JSON with its integers exact: those beyond a double's are BigInt. */
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
