// The page: it opens the view that the address names, refreshes it, and shows errors.

import { read } from "./address.js";
import { pause, Problem, remember } from "./api.js";
import { now } from "./clock.js";
import { compareView } from "./compare.js";
import { h } from "./dom.js";
import { editorView } from "./editor.js";
import { sessionView } from "./session.js";
import { sessionsView } from "./sessions.js";
import { specView, specsView } from "./specs.js";
import { moment } from "./words.js";

const PERIOD = 1000;
const SHARE = 10; // requests take at most one tenth of the time where the answers are slow,
const LONGEST = 5000; // ms, but nobody looks at what is older than this
const SOON = 300; // ms for which what is much older, as where nobody looked at the page, stands as if it were of now

const place = document.getElementById("view");
const link = document.getElementById("link");
let timer;
let latest = 0; // the number of the last refresh
let fresh = null; // when (ms) what is shown was asked for; null before it is there
let wait = PERIOD; // ms until the next refresh
let view = sessionsView({}, refresh);

function route() {
  const address = read();
  const { kind, id, other } = address;
  if (kind === "sessions" && id) return sessionView(address, refresh, begin);
  if (kind === "compare" && id) return compareView(id, other);
  if (kind === "edit" && id) return editorView(id);
  if (kind === "specs") return id ? specView(id) : specsView();
  return sessionsView(address, refresh);
}

function open() {
  const address = read();
  if (view.goTo && address.kind === "sessions" && view.key === address.id) view.goTo(address);
  else return begin();
  return refresh();
}

/** Open the view that the address names from its beginning. */
function begin() {
  view.leave?.();
  view = route();
  fresh = null;
  document.title = view.key ? `${view.key} – oracle-server` : "oracle-server";
  place.replaceChildren(view.node);
  const here = ["specs", "edit"].includes(read().kind) ? "#/specs" : "#/";
  for (const each of document.querySelectorAll("nav a")) each.toggleAttribute("aria-current", each.getAttribute("href") === here);
  return refresh();
}

/** Refresh the view, and schedule the next refresh in any case; an earlier refresh has no effect any more. */
async function refresh() {
  clearTimeout(timer);
  const mine = ++latest;
  const [begin, asked] = [performance.now(), now()];
  const old = fresh !== null && asked - fresh > wait + LONGEST;
  const slow = setTimeout(() => mine === latest && !document.hidden && outdated("The server is slow; waiting for it."), old ? SOON : LONGEST);
  try {
    if (document.hidden) return;
    await view.refresh();
    if (mine !== latest) return;
    fresh = asked;
    showStatus(true, connected(pause()));
  } catch (problem) {
    if (mine === latest) failed(problem);
  } finally {
    clearTimeout(slow);
    if (mine === latest) timer = setTimeout(refresh, (wait = Math.max(PERIOD, Math.min(LONGEST, SHARE * (performance.now() - begin)), pause())));
  }
}

function failed(problem) {
  if (problem instanceof Problem) return refused(problem);
  console.error(problem);
  outdated("The page is not up to date: an answer of the server could not be shown; trying again.");
}

function refused(problem) {
  const needsToken = problem.document && [401, 403].includes(problem.status);
  if (!needsToken) outdated(problem.document ? problem.message : `${problem.message.replace(/\.$/, "")}; trying again.`);
  else if (!link.querySelector("form")) outdated(problem.message, tokenForm());
}

/** That the server answers, and how often it is asked (ms) where that is seldom: what is shown may be so old. */
function connected(pace) {
  return pace > LONGEST ? `connected; there is much, and it is brought up to date every ${Math.ceil(pace / LONGEST) * (LONGEST / 1000)} s` : "connected";
}

/** Say why what is shown is not as it is now, and of when it is. */
function outdated(why, ...more) {
  const when = fresh === null ? "" : `${why.endsWith(".") ? "" : "."} What is shown is of ${moment(fresh * 1e6).slice(0, -4)}.`;
  showStatus(false, `${why}${when}`, ...more);
}

function showStatus(good, text, ...more) {
  if (link.textContent === text && !more.length) return;
  link.className = good ? "good" : "bad";
  place.classList.toggle("stale", !good);
  link.replaceChildren(text, ...more);
}

function tokenForm() {
  const field = h("input", { type: "password", name: "token", "aria-label": "token", autocomplete: "off" });
  const entered = (submitted) => {
    submitted.preventDefault();
    remember(field.value.trim());
    outdated("Asking with this token.");
    refresh();
  };
  return h("form", { onsubmit: entered }, field, h("button", {}, "Use"));
}

document.addEventListener("keydown", (pressed) => {
  const field = document.querySelector("main input[type=search]");
  if (pressed.key !== "/" || !field || pressed.target.matches("input, textarea, select")) return;
  pressed.preventDefault();
  field.focus();
});
document.querySelector(".skip").addEventListener("click", (click) => {
  click.preventDefault(); // the address names what is shown
  place.focus();
});
addEventListener("hashchange", open);
document.addEventListener("visibilitychange", () => document.hidden || refresh());
open();
