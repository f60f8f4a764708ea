// What a sequence diagram shows of events: who they are between, in which rows, and in which words.

import { awaited, ordered, span, stream, waiting } from "./words.js";

const BACK = new Set(["response", "reply", "feedback", "result", "status"]); // from who serves to who asked
const BEGINS = { request: "response", goal: "result" };
const GROUPS = { topic: "topic", request: "service", response: "service" };
const GAP = 100e6; // ns
const FEW = 2; // signals

/** Rows from top to bottom of events from the API, each `at` (ns) behind `origin`, and the lifelines that they touch. */
export function rowsOf(items, origin) {
  const rows = items.flatMap((item) => [messageOf(item, origin), decisionOf(item, origin)]).filter(Boolean);
  rows.sort((one, other) => one.at - other.at);
  rows.forEach((row, i) => (row.gap = i && row.at - rows[i - 1].at > GAP ? span(row.at - rows[i - 1].at) : null));
  return { rows, lifelines: lifelinesOf(rows), calls: callsOf(rows) };
}

function messageOf(item, origin) {
  const at = Number(BigInt(ordered(item)) - origin);
  if (item.kind === "tick") return { what: "deadline", item, at, label: failing(item) || "deadline" };
  const { from, to } = endsOf(item);
  const stops = item.asked || (item.kind === "topic" && item.source) || from === to;
  return { what: "message", item, at, from, to: stops ? monitorOf(item) : to, via: monitorOf(item), label: labelOf(item) };
}

/** What became of an event that was asked about: a row of its own, once it was decided. */
function decisionOf(item, origin) {
  if (!item.asked || !item.decision) return null;
  const sent = Number(BigInt(ordered(item)) - origin);
  const decided = sent + Number(item.held ?? 0); // by the clock of its stamp, which need not be the server's
  const held = (item.held ?? 0) < 1e6 ? "" : `, held ${span(item.held)}${item.waited.length ? ` by ${awaited(item)}` : ""}`;
  const denied = item.decision === "deny";
  const passed = denied && item.passed ? ", but passed on" : !denied && item.passed === false ? ", but withheld" : "";
  const by = denied && item.denied_by.length ? ` by ${item.denied_by.join(", ")}` : "";
  const { to } = endsOf(item);
  return { what: denied ? "denied" : "allowed", item, at: decided, from: monitorOf(item), to, label: `${denied ? "denied" : "allowed"}${by}${held}${passed}` };
}

/** Between whom an event is: nodes where they are known, else the stream itself, or those who ask on it. */
function endsOf({ kind, stream: name, source }) {
  const served = { key: `stream ${name}`, name, hint: GROUPS[kind] ?? "action" };
  const others = { key: `others ${name}`, name: kind === "topic" ? "a publisher" : "a client", hint: `of ${name}; which one is not told` };
  const node = source ? { key: `node ${source}`, name: source, hint: "publishes" } : null;
  if (BACK.has(kind)) return { from: node ?? served, to: others };
  if (kind === "topic" && !node) return { from: served, to: served };
  return { from: node ?? others, to: served };
}

function monitorOf({ monitor }) {
  return { key: `monitor ${monitor}`, name: monitor, hint: "monitor" };
}

function lifelinesOf(rows) {
  const found = new Map();
  for (const { from, to, via } of rows) for (const each of [from, to, via]) if (each) found.set(each.key, each);
  const rank = ({ key }) => (key.startsWith("monitor ") ? 1 : key.startsWith("stream ") ? 2 : 0);
  return [...found.values()].sort((one, other) => rank(one) - rank(other));
}

/** Calls and goals that begin and end in view: the stream that serves each, and the rows where they do. */
function callsOf(rows) {
  const open = new Map();
  const found = [];
  rows.forEach(({ what, item }, row) => {
    if (what !== "message") return;
    const id = item.goal_id ?? item.call;
    if (id === null) return;
    const key = JSON.stringify([item.monitor, item.stream, item.goal_id ? "goal" : "call", id]);
    if (BEGINS[item.kind]) open.set(key, { row, ends: BEGINS[item.kind] });
    else if (open.get(key)?.ends === item.kind) {
      found.push({ stream: `stream ${item.stream}`, from: open.get(key).row, to: row });
      open.delete(key);
    }
  });
  return found;
}

function labelOf(item) {
  const signals = Object.entries(item.signals).slice(0, FEW).map(([name, value]) => `${name} ${shown(value)}`);
  const row = item.row == null ? null : `row ${item.row}`;
  return [stream(item.stream, item.kind), row, ...signals, item.status].filter(Boolean).join(" ") + late(item);
}

function late({ late: is, stamp, arrived, judged, lost }) {
  const marks = [is && `late ${span(Number(BigInt(arrived) - BigInt(stamp)))}`, !judged && "not judged", lost && `${lost} lost before`];
  return marks.filter(Boolean).map((mark) => `, ${mark}`).join("");
}

function shown(value) {
  return typeof value === "number" ? String(Number(value.toPrecision(5))) : typeof value === "string" ? JSON.stringify(value) : String(value);
}

/** For what an event waited, and how long. */
function waits(item) {
  const why = waiting(item);
  return why && `${item.held === null ? "" : `held ${span(item.held)}: `}${why}`;
}

function failing({ violated }) {
  return violated.length ? `${violated.map(({ property }) => property).join(", ")} fails` : "";
}

/** All that is told of a row, as a sentence. */
export function sentence(row) {
  const { what, item, label } = row;
  const fails = failing(item);
  if (what === "deadline") return `${offset(row.at)}: a deadline ran out; ${label}`;
  const ends = `from ${row.from.name} to ${row.to.name}`;
  const call = item.goal_id ? `goal ${item.goal_id}` : item.call === null ? "" : `call ${item.call}`;
  const all = Object.entries(item.signals).map(([name, value]) => `${name} = ${shown(value)}`).join(", ");
  const rest = what === "message" ? [ends, all, item.more_signals ? `and ${item.more_signals} more signals` : "", call, item.asked ? "asked about" : waits(item), fails] : [waits(item)];
  return `${offset(row.at)}: ${[label, ...rest].filter(Boolean).join("; ")}`;
}

/** A time behind the moment that is shown, in ms or s. */
export function offset(nanoseconds) {
  const ms = nanoseconds / 1e6;
  const [value, unit] = Math.abs(ms) >= 10_000 ? [ms / 1000, " s"] : [ms, ""];
  const digits = Math.abs(value) >= 100 || Number.isInteger(value) ? 0 : 1;
  return value ? `${value < 0 ? "−" : "+"}${Math.abs(value).toFixed(digits)}${unit}` : "0";
}
