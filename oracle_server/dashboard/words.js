// The wording of outcomes, times, events and streams.

import { now } from "./clock.js";
import { h } from "./dom.js";

const MARKS = { true: "✔", currently_true: "✓", currently_false: "✗", false: "✘", unknown: "?" };
const GRAVEST_FIRST = ["false", "currently_false", "unknown", "currently_true", "true"];

/** The sign of an outcome, for readers who can't see its colour. */
export function mark(outcome) {
  return MARKS[outcome] ?? "?";
}

/** An outcome with its sign, as a coloured element. */
export function badge(outcome) {
  return h("span", { class: `outcome ${outcome}` }, `${mark(outcome)} ${outcome}`);
}

/** Compares two outcomes; the gravest is sorted first. */
export function byGravity(one, other) {
  return GRAVEST_FIRST.indexOf(one) - GRAVEST_FIRST.indexOf(other);
}

/** The text of a time (ns): the time of day for the wall clock, seconds for a simulated one. */
export function moment(nanoseconds, clock = "wall") {
  if (nanoseconds === null || nanoseconds === undefined) return "–";
  if (clock === "sim") return `${(Number(nanoseconds) / 1e9).toFixed(3)} s`;
  const date = new Date(Number(nanoseconds) / 1e6);
  return `${day(date)}${date.toTimeString().slice(0, 8)}.${String(date.getMilliseconds()).padStart(3, "0")}`;
}

/** The time zone in which a time (ns) is told here, as UTC+1: explanations tell theirs in UTC. */
export function zone(nanoseconds) {
  const ahead = -new Date(Number(nanoseconds) / 1e6).getTimezoneOffset();
  const [hours, minutes] = [Math.floor(Math.abs(ahead) / 60), Math.abs(ahead) % 60];
  return ahead ? `UTC${ahead < 0 ? "-" : "+"}${hours}${minutes ? `:${String(minutes).padStart(2, "0")}` : ""}` : "UTC";
}

/** The text of the time (ns) from one to another, with the time zone, or both where clocks are set meanwhile. */
export function stretch(since, until, clock) {
  const [from, to] = [since, until].map((time) => moment(time, clock));
  if (clock === "sim") return `${from} to ${to}`;
  const [before, after] = [zone(since), zone(until)];
  return before === after ? `${from} to ${to}, ${after}` : `${from}, ${before} to ${to}, ${after}`;
}

/** Where an event stands in the order of publication (ns): a stamp too far ahead does not count, but its arrival. */
export function ordered({ stamp, arrived, skewed }) {
  return skewed ? arrived : stamp;
}

/** The text of a step: its number, which a deadline has not, and its time. */
export function place(number, stamp, clock) {
  return `${number === null ? "" : `step ${number}, `}${moment(stamp, clock)}`;
}

function day(date) {
  return date.toDateString() === new Date(now()).toDateString() ? "" : `${date.toLocaleDateString("sv")} `;
}

/** The text of a duration (ns). */
export function span(nanoseconds) {
  if (nanoseconds === null || nanoseconds === undefined) return "–";
  const ms = Number(nanoseconds) / 1e6;
  if (Math.abs(ms) < 1000) return `${Math.abs(ms) < 10 ? ms.toFixed(1) : Math.round(ms)} ms`;
  const s = ms / 1000;
  if (s < 120) return `${s.toFixed(1)} s`;
  const [size, unit] = s < 7200 ? [60, "min"] : s < 172_800 ? [3600, "h"] : [86_400, "days"];
  return `${Math.round(s / size)} ${unit}`;
}

/** How a session stands, in a few words: `live` says that monitors are there. */
export function life({ kind, status, live, idle, since, clock }) {
  const alone = since ? ` since ${moment(since)}` : "";
  const words = status !== "open" ? status : kind === "recording" ? "being judged" : live ? "live" : idle ? `idle${alone}` : `open, no monitor${alone}`;
  return [words, kind === "recording" && "recording", clock === "sim" && "simulated time"].filter(Boolean).join(", ");
}

/** The text of a count; "–" for zero. */
export function count(value) {
  return value ? String(value) : "–";
}

/** A number of things, as in "1 violation". */
export function counted(number, name) {
  return `${number} ${name}${number === 1 ? "" : "s"}`;
}

/** The text of the event of a record or reason. */
export function event(of) {
  if (of.kind === "tick") return "an expired deadline";
  return `${of.stream} (${of.kind} ${of.seq} of ${of.monitor}${of.row == null ? "" : `, row ${of.row}`})`;
}

/** The streams, each with its monitor, that an event waited for. */
export function awaited({ waited }) {
  return (waited ?? []).map((each) => `${stream(each.stream, each.kind)} of ${each.monitor}`).join(", ");
}

const ENDS = {
  frontier: "and went on once nothing older could come from there",
  clock: "and went on once nothing older could come from there",
  max_delay: "in vain: `max_delay` was over",
  capacity: "in vain: there was no room to wait on",
};

/** For what an event waited before its turn came, and what ended that; empty where it waited for nothing. */
export function waiting(of) {
  return of.waited?.length ? `waited for ${awaited(of)}, ${ENDS[of.released]}` : "";
}

/** The text of the late events that a revision was made for: the first one with its delay, and how many more. */
export function causes({ because, causes: all, arrived }) {
  const [first] = because;
  const ms = first.stamp === null ? 0 : Math.floor((Number(arrived) - Number(first.stamp)) / 1e6);
  return `${event(first)} came ${ms > 0 ? `${ms} ms ` : ""}late${all > 1 ? `, and ${all - 1} more` : ""}`;
}

const MANY = { reply: "replies", feedback: "feedback", status: "status" };

/** A stream's name, with its kind for the streams of a service or an action. */
export function stream(name, kind) {
  return kind === "topic" ? name : `${name} ${MANY[kind] ?? `${kind}s`}`;
}
