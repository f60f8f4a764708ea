// The page: it opens the view that the address names, refreshes it, and shows errors.

import { Problem, remember } from "./api.js";
import { h } from "./dom.js";
import { sessionView } from "./session.js";
import { sessionsView } from "./sessions.js";
import { specView, specsView } from "./specs.js";

const PERIOD = 1000;
const SHARE = 10; // requests take at most one tenth of the time, however slow the answers are

const place = document.getElementById("view");
const link = document.getElementById("link");
let view = sessionsView();
let timer;
let latest = 0; // the number of the last refresh

function route() {
  const [path, query] = location.hash.slice(1).split("?");
  const [, kind, id] = path.split("/").map(decoded);
  if (kind === "sessions" && id) return sessionView(id, Number(new URLSearchParams(query).get("n")) || null, refresh);
  if (kind === "specs") return id ? specView(id) : specsView();
  return sessionsView();
}

function decoded(part) {
  try {
    return decodeURIComponent(part);
  } catch {
    return "";
  }
}

function open() {
  const next = route();
  const same = view.goTo && view.key === next.key;
  if (same) view.goTo(next.n);
  else {
    view.leave?.();
    view = next;
    document.title = view.key ? `${view.key} – oracle-server` : "oracle-server";
    place.replaceChildren(view.node);
  }
  return refresh();
}

/** Refresh the view, and schedule the next refresh in any case; an earlier refresh has no effect any more. */
async function refresh() {
  clearTimeout(timer);
  const mine = ++latest;
  const begin = performance.now();
  try {
    if (document.hidden) return;
    await view.refresh();
    if (mine === latest) showStatus(true, "connected");
  } catch (problem) {
    if (mine === latest) failed(problem);
  } finally {
    if (mine === latest) timer = setTimeout(refresh, Math.max(PERIOD, SHARE * (performance.now() - begin)));
  }
}

function failed(problem) {
  if (problem instanceof Problem) return refused(problem);
  console.error(problem);
  showStatus(false, "The page is not up to date: an answer of the server could not be shown; trying again.");
}

function refused(problem) {
  const needsToken = [401, 403].includes(problem.status);
  if (!needsToken) showStatus(false, problem.message);
  else if (!link.querySelector("form")) showStatus(false, problem.message, tokenForm());
}

function showStatus(good, text, ...more) {
  if (link.textContent === text && !more.length) return;
  link.className = good ? "good" : "bad";
  link.replaceChildren(text, ...more);
}

function tokenForm() {
  const field = h("input", { type: "password", name: "token", "aria-label": "token", autocomplete: "off" });
  const entered = (submitted) => {
    submitted.preventDefault();
    remember(field.value.trim());
    showStatus(true, "…");
    refresh();
  };
  return h("form", { onsubmit: entered }, field, h("button", {}, "Use"));
}

document.querySelector(".skip").addEventListener("click", (click) => {
  click.preventDefault(); // the address names what is shown
  place.focus();
});
addEventListener("hashchange", open);
document.addEventListener("visibilitychange", () => document.hidden || refresh());
open();
