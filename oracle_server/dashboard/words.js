// How outcomes, times and events are told.

import { h } from "./dom.js";

const MARKS = { true: "✔", currently_true: "✓", currently_false: "✗", false: "✘", unknown: "?" };
const GRAVEST_FIRST = ["false", "currently_false", "unknown", "currently_true", "true"];

/** The sign of an outcome, for those who don't see its colour. */
export function mark(outcome) {
  return MARKS[outcome] ?? "?";
}

/** An outcome, in the words of the records. */
export function badge(outcome) {
  return h("span", { class: `outcome ${outcome}` }, `${mark(outcome)} ${outcome}`);
}

/** The gravest of some outcomes first. */
export function byGravity(one, other) {
  return GRAVEST_FIRST.indexOf(one) - GRAVEST_FIRST.indexOf(other);
}

/** A moment in nanoseconds: of the day on a wall clock, in seconds on a simulated one. */
export function moment(nanoseconds, clock = "wall") {
  if (nanoseconds === null || nanoseconds === undefined) return "–";
  if (clock === "sim") return `${(Number(nanoseconds) / 1e9).toFixed(3)} s`;
  const date = new Date(Number(nanoseconds) / 1e6);
  return `${day(date)}${date.toTimeString().slice(0, 8)}.${String(date.getMilliseconds()).padStart(3, "0")}`;
}

function day(date) {
  return date.toDateString() === new Date().toDateString() ? "" : `${date.toLocaleDateString("sv")} `;
}

/** A span of time in nanoseconds. */
export function span(nanoseconds) {
  if (nanoseconds === null || nanoseconds === undefined) return "–";
  const ms = Number(nanoseconds) / 1e6;
  if (Math.abs(ms) < 1000) return `${Math.abs(ms) < 10 ? ms.toFixed(1) : Math.round(ms)} ms`;
  const s = ms / 1000;
  if (s < 120) return `${s.toFixed(1)} s`;
  const [size, unit] = s < 7200 ? [60, "min"] : s < 172_800 ? [3600, "h"] : [86_400, "days"];
  return `${Math.round(s / size)} ${unit}`;
}

/** A count, with what is none kept quiet. */
export function count(value) {
  return value ? String(value) : "–";
}

/** What a record or a reason is about. */
export function event(of) {
  if (of.kind === "tick") return "a deadline that ran out";
  return `${of.stream} (${of.kind} ${of.seq} of ${of.monitor})`;
}

/** The address of a session on this page, or of its verdict `n`. */
export function at(session, n) {
  return `#/sessions/${encodeURIComponent(session)}${n ? `?n=${n}` : ""}`;
}

/** A stream's name, and its kind where it is a service's. */
export function stream(name, kind) {
  return kind === "topic" ? name : `${name} ${kind}s`;
}
