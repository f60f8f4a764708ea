// A client of the server's HTTP API.

import { heard } from "./clock.js";

const TOKEN = "oracle-token";
const TIMEOUT = 10_000; // ms
const REFRESHES = 10;
const RATE = 15; // bytes a ms that are asked for on average, however much there is
const BURST = 200_000; // bytes that may come at once

const kept = new Map(); // documents by what was asked, with their tags
let [left, filled] = [BURST, performance.now()];

const ELSEWHERE = { // what stands in front of the server answers so: the server itself says why
  401: "A proxy in front of the server wants a login (401): load this page again for it.",
  403: "A proxy in front of the server refuses this (403): ask who runs it to let it through.",
  407: "A proxy in front of the server wants a login (407): load this page again for it.",
  413: "What was sent is larger than a proxy in front of the server lets through (413): raise its limit, as nginx's client_max_body_size, or send it to the server itself.",
  429: "A proxy in front of the server takes no more requests for now (429).",
  502: "A proxy in front of the server can't reach it (502): see whether the server runs.",
  503: "A proxy in front of the server can't reach it (503): see whether the server runs.",
  504: "A proxy in front of the server had no answer of it in time (504): see whether the server runs, and how long the proxy waits, as nginx's proxy_read_timeout.",
};

/** A request that failed: `status` is HTTP's, or 0 where the server can't be reached; `document` is what it says, null where that is not the server. */
export class Problem extends Error {
  constructor(status, message, document = null) {
    super(message);
    [this.status, this.document] = [status, document];
  }
}

/** Store a token for this tab, until it is closed. */
export function remember(token) {
  sessionStorage.setItem(TOKEN, token);
}

/** Get a document within `within` ms; `signal` aborts the request. Throws a `Problem`. */
export async function get(path, query = {}, options = {}) {
  return (await ask("GET", path, query, options)).document;
}

/** Get a document that is kept, and sent again only where it has changed. Throws a `Problem`. */
export async function getKept(path, query = {}) {
  const key = JSON.stringify([path, query, sessionStorage.getItem(TOKEN)]);
  const before = kept.get(key);
  const found = await ask("GET", path, query, { headers: before ? { "If-None-Match": before.tag } : {} });
  if (!found.document) return before.document;
  if (found.tag) kept.set(key, found);
  return found.document;
}

/** How long to wait (ms) until more is asked for, so that a page that is left open costs the network little. */
export function pause() {
  const now = performance.now();
  [left, filled] = [Math.min(BURST, left + RATE * (now - filled)), now];
  return Math.max(0, -left / RATE);
}

/** Send a request, and get the document that answers it, with its `ETag`. Throws a `Problem`. */
export async function ask(method, path, query = {}, { within = TIMEOUT, signal, body, headers: more = {} } = {}) {
  const url = new URL(`api/v1/${path}`, document.baseURI);
  for (const [name, value] of Object.entries(query)) [value].flat().forEach((each) => url.searchParams.append(name, each));
  const token = sessionStorage.getItem(TOKEN);
  if (/[^!-~]/.test(token ?? "")) throw new Problem(401, "The token has a character that no token has.", {}); // nor any header: nothing would be sent
  const headers = { ...more, ...(token ? { Authorization: `Bearer ${token}` } : {}) };
  const ends = AbortSignal.any([AbortSignal.timeout(within), ...(signal ? [signal] : [])]);
  let response, text;
  try {
    response = await fetch(url, { method, body, headers, signal: ends, cache: "no-store" });
    heard(response.headers.get("Date"));
    text = await response.text();
  } catch {
    throw new Problem(0, "The server can't be reached.");
  }
  left -= Number(response.headers.get("Content-Length") ?? text.length);
  if (response.status === 304) return { document: null, tag: null };
  const document_ = parsed(text);
  if (response.ok && document_ instanceof Object && !Array.isArray(document_)) return { document: document_, tag: response.headers.get("ETag") };
  const detail = response.ok ? "The page is not up to date: this answers, but not as an oracle server." : undefined;
  throw new Problem(response.status, detail ?? refusal(response.status, document_), document_?.detail ? document_ : null);
}

/** Send a file, and get the document that answers it; `progress` is told how much of it is sent, from 0 to 1. Throws a `Problem`. */
export function send(path, query, file, { signal, progress }) {
  const request = new XMLHttpRequest(); // fetch does not tell how far it is
  const url = new URL(`api/v1/${path}`, document.baseURI);
  for (const [name, value] of Object.entries(query)) url.searchParams.append(name, value);
  return new Promise((sent, failed) => {
    request.open("POST", url);
    const token = sessionStorage.getItem(TOKEN);
    if (token) request.setRequestHeader("Authorization", `Bearer ${token}`);
    request.upload.onprogress = (event) => event.lengthComputable && progress(event.loaded / event.total);
    request.onload = () => {
      const answer = parsed(request.responseText);
      if (request.status < 300 && answer) sent(answer);
      else failed(new Problem(request.status, refusal(request.status, answer)));
    };
    request.onabort = () => failed(new Problem(0, "The sending was cancelled."));
    request.onerror = () => failed(new Problem(0, "The server ended the sending, or can't be reached."));
    signal.addEventListener("abort", () => request.abort());
    request.send(file);
  });
}

/** Why a request was refused, in words. */
function refusal(status, answer) {
  return answer?.detail ?? ELSEWHERE[status] ?? `A proxy in front of the server, and not the server, answered ${status}: see how it is set up.`;
}

/** Get the items of a list, by `get` or `getKept`. Throws a `Problem`, or a `TypeError` where the answer is not a list. */
export async function items(path, query = {}, read = get) {
  const found = (await read(path, query)).items;
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
