// The rows of the timeline: what each shows of an answer by time, and what stands beside it.

import { paintDecisions, paintLane, paintSignal, paintStream } from "./painting.js";
import { counted, mark, span } from "./words.js";

const MOODS = { true: "good", currently_true: "good", false: "bad", currently_false: "bad", unknown: "unsure" };

/** The rows of an answer; each has its `group`, `name`, `value`, and `paint(canvas, window)`. */
export function rowsOf(answer, state, thresholds, window) {
  const time = timeOf(answer, window);
  return [
    ...properties(answer, state, time),
    ...streams(answer, time),
    ...signals(answer, thresholds, time),
    ...decisions(answer, time),
  ];
}

/** One lane with the worst outcome of all properties. */
export function worstOf(answer, window) {
  const lanes = Object.values(answer.lanes);
  const codes = Array.from(lanes[0] ?? "", (_, i) => lanes.map((codes) => codes[i]).sort(byGravity)[0]).join("");
  return { ...timeOf(answer, window), codes };
}

const GRAVEST_FIRST = "FfutT- ";

function byGravity(one, other) {
  return GRAVEST_FIRST.indexOf(one) - GRAVEST_FIRST.indexOf(other);
}

function timeOf({ since, width }, window) {
  return { since: window.offset(since), width: Number(width) };
}

function properties(answer, state, time) {
  const standing = new Map(state.properties.map((each) => [each.id, each]));
  return Object.entries(answer.lanes).map(([name, codes]) => {
    const { outcome = "unknown", violations = 0 } = standing.get(name) ?? {};
    return {
      group: "property", name, title: `${name}: ${outcome}`,
      value: `${mark(outcome)} ${violations ? counted(violations, "violation") : ""}`.trim(), mood: MOODS[outcome],
      paint: (canvas, window) => paintLane(canvas, window, { ...time, codes, degraded: answer.degraded[name] }),
    };
  });
}

function streams(answer, { since, width }) {
  return Object.entries(answer.streams).map(([key, { count: counts, lost }]) => {
    const total = counts.reduce((sum, each) => sum + each, 0);
    const seconds = (counts.length * width) / 1e9;
    return {
      group: "stream", name: key, value: rate(total, seconds),
      paint: (canvas, window) => paintStream(canvas, window, { since, width, counts, lost }),
    };
  });
}

function rate(total, seconds) {
  if (total < 3) return `${total} in view`;
  const hertz = total / seconds;
  return `${hertz < 10 ? hertz.toFixed(1) : Math.round(hertz)} Hz`;
}

function signals(answer, thresholds, time) {
  return Object.entries(answer.signals).filter(([, { count }]) => count.some(Boolean)).map(([key, found]) => {
    const bounds = thresholds.filter((each) => each.signal === key);
    const [min, max, mean] = [found.min, found.max, found.mean].map((values) => values.map(plotted));
    const [stream, name] = [key.slice(0, key.lastIndexOf(":")), key.slice(key.lastIndexOf(":") + 1)];
    return {
      group: "signal", name, tall: true, value: last(mean),
      title: [`${name} of ${stream}`, ...bounds.map(({ property, op, value }) => `${property}: ${op} ${value}`)].join("; "),
      paint: (canvas, window) => paintSignal(canvas, window, { ...time, min, max, mean }, bounds),
    };
  });
}

/** A value as it is drawn: near enough where it is an integer that a double can't represent. */
function plotted(value) {
  return value === null ? null : Number(value);
}

function last(values) {
  const found = values.findLast((value) => value !== null);
  return found === undefined ? "" : String(Number(found.toPrecision(4)));
}

function decisions({ asked, denied, hold }, time) {
  const [all, no] = [asked, denied].map((counts) => counts.reduce((sum, each) => sum + each, 0));
  if (!all) return [];
  const longest = hold ? `held ${span(Math.max(...hold.max))} at most` : "";
  return [{
    group: "decision", name: "decisions", title: "asked, and denied; below, how long each waited", tall: true,
    value: [`${no} of ${all} denied`, longest].filter(Boolean).join(", "), mood: no ? "denied" : "",
    paint: (canvas, window) => paintDecisions(canvas, window, { ...time, asked, denied, hold: hold?.max ?? [] }),
  }];
}
