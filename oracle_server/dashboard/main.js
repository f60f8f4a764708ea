// The page: which view the address names, when it is brought up to date, and what stands in its way.

import { Problem, remember } from "./api.js";
import { h } from "./dom.js";
import { sessionView } from "./session.js";
import { sessionsView } from "./sessions.js";
import { specView, specsView } from "./specs.js";

const PERIOD = 1000;
const SHARE = 10; // of the time at most one part goes into asking, however slow the answers are

const place = document.getElementById("view");
const link = document.getElementById("link");
let view = sessionsView();
let timer;
let turn = 0;

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

/** Bring the view up to date, and again when it is time, whatever happens; what was asked for before is forgotten. */
async function refresh() {
  clearTimeout(timer);
  const mine = ++turn;
  const asked = performance.now();
  try {
    if (document.hidden) return;
    await view.refresh();
    if (mine === turn) tell(true, "live");
  } catch (problem) {
    if (mine === turn) failed(problem);
  } finally {
    if (mine === turn) timer = setTimeout(refresh, Math.max(PERIOD, SHARE * (performance.now() - asked)));
  }
}

function failed(problem) {
  if (problem instanceof Problem) return refused(problem);
  console.error(problem);
  tell(false, "The page is not up to date: an answer of the server could not be shown; trying again.");
}

function refused(problem) {
  const shut = [401, 403].includes(problem.status);
  if (!shut) tell(false, problem.message);
  else if (!link.querySelector("form")) tell(false, problem.message, tokenForm());
}

function tell(good, text, ...more) {
  if (link.textContent === text && !more.length) return;
  link.className = good ? "good" : "bad";
  link.replaceChildren(text, ...more);
}

function tokenForm() {
  const field = h("input", { type: "password", name: "token", "aria-label": "token", autocomplete: "off" });
  const entered = (submitted) => {
    submitted.preventDefault();
    remember(field.value.trim());
    tell(true, "…");
    refresh();
  };
  return h("form", { onsubmit: entered }, field, h("button", {}, "Use"));
}

addEventListener("hashchange", open);
document.addEventListener("visibilitychange", () => document.hidden || refresh());
open();
