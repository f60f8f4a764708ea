// The rows of the timeline: what each shows of an answer by time, and what stands beside it.

import { paintDecisions, paintLane, paintSignal, paintStream } from "./painting.js";
import { lasted } from "./episodes.js";
import { counted, mark, moment, span } from "./words.js";

const SELDOM = 0.1; // Hz: what comes less often would be told as 0.0
const LARGE = 1e9; // a number that has as many digits as there is room for
const MOODS = { true: "good", currently_true: "good", false: "bad", currently_false: "bad", unknown: "unsure" };

/**
 * The rows of an answer; each has its `key`, `group`, `name`, `value`, and `paint(canvas, window)`. `found` are the
 * session's episodes, `now` is the time of its newest step, `awaited` are the streams that held up what is explained.
 */
export function rowsOf(answer, { state, thresholds, found, now, awaited = [] }, window) {
  const time = timeOf(answer, window);
  return [
    ...properties(answer, state, found, now, time, window),
    ...streams(answer, time, window, awaited),
    ...signals(answer, thresholds, time, window),
    ...decisions(answer, time, window),
  ].map((row) => ({ key: `${row.group} ${row.name}`, ...row }));
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

function properties(answer, state, found, now, time, window) {
  const standing = new Map(state.properties.toReversed().map((each) => [each.id, each])); // by the order that decides, which is first
  return Object.entries(answer.lanes).map(([name, codes]) => {
    const { outcome = "unknown", violations = 0, order, caveats = [], degraded = false } = standing.get(name) ?? {};
    const own = found.filter((each) => each.property === name && (!order || each.order === order));
    const open = own.find((each) => each.open);
    const lane = { ...time, codes, degraded: answer.degraded[name], counts: answer.violations[name] };
    const told = [violations ? counted(violations, "violation") : "", open ? `for ${span(lasted(open, now))}` : ""];
    const doubt = caveats.length || degraded ? "degraded" : "";
    return {
      group: "property", name, title: [`${name}: ${outcome}`, ...caveats.map((text) => `degraded: ${text}`)].join("; "), open: Boolean(open), said: inWords(name, outcome, own, state.clock),
      value: [mark(outcome), doubt, open ? told[1] : told[0]].filter(Boolean).join(" "), mood: doubt && MOODS[outcome] === "good" ? "unsure" : MOODS[outcome],
      holds: !open && !doubt && MOODS[outcome] === "good" && holdsThroughout(lane, window),
      together,
      codes, degraded: lane.degraded, time,
      paint: (canvas, now_) => paintLane(canvas, now_, lane),
    };
  });
}

/** A property's lane in words, for those who can't see it: how it stands, and its newest episodes. */
function inWords(name, outcome, episodes, clock) {
  const told = episodes.slice(0, 3).map(({ began, until, open }) => `${moment(began, clock)} to ${open ? "now" : moment(until, clock)}`);
  return [`${name}: ${outcome}`, told.length ? `failed ${told.join(", ")}${episodes.length > 3 ? ", and before" : ""}` : null].filter(Boolean).join("; ");
}

/** Whether a lane is known to hold in all of the window that is told, and nothing in it is degraded. */
function holdsThroughout({ since, width, codes, degraded = "" }, window) {
  const [from, to] = [window.since, window.until].map((at) => Math.min(codes.length, Math.max(0, Math.floor((at - since) / width))));
  const before = codes.slice(0, from).replace(/[ -]/g, "").at(-1) ?? "";
  const inside = codes.slice(from, to + 1).replace(/[ -]/g, "");
  return /^[tT]+$/.test(before + inside) && !degraded.slice(from, to + 1).includes("1");
}

/** One row for several lanes that hold. */
function together(rows) {
  const [{ codes, time }] = rows;
  const lane = { ...time, codes: Array.from(codes, (code, i) => (rows.some((each) => each.codes[i] === "t") ? "t" : code)).join("") };
  return {
    name: `${rows.length} hold`, title: rows.map(({ name }) => name).join(", "), value: "✓", mood: "good",
    said: `${rows.length} properties hold in all of this time`,
    paint: (canvas, window) => paintLane(canvas, window, lane),
  };
}

/** The values of the buckets that begin in the window: an answer has some on both sides, too. */
function inView(values, { since, width }, window) {
  return values.filter((_, i) => since + i * width >= window.since - width / 2 && since + i * width <= window.until);
}

function streams(answer, time, window, awaited) {
  const { since, width } = time;
  return Object.entries(answer.streams).map(([key, { count: counts, lost }]) => {
    const seen = inView(counts, time, window);
    const total = seen.reduce((sum, each) => sum + each, 0);
    const seconds = (seen.length * width) / 1e9;
    return {
      group: "stream", name: key, title: key, ...valueOf(rate(total, seconds), awaited.includes(key)),
      paint: (canvas, window) => paintStream(canvas, window, { since, width, counts, lost }),
    };
  });
}

function valueOf(rate, isAwaited) {
  return isAwaited ? { value: `waited for, ${rate}`, mood: "unsure" } : { value: rate };
}

function rate(total, seconds) {
  if (total < 3) return `${total} in view`;
  const hertz = total / seconds;
  if (hertz < SELDOM) return `every ${span((seconds / total) * 1e9)}`;
  return `${hertz < 10 ? hertz.toFixed(1) : Math.round(hertz)} Hz`;
}

function signals(answer, thresholds, time, window) {
  const failing = new Set(Object.entries(answer.lanes).filter(([, codes]) => /f/i.test(codes)).map(([name]) => name));
  return Object.entries(answer.signals).filter(([, { count }]) => count.some(Boolean)).map(([key, found]) => {
    const bounds = thresholds.filter((each) => each.signal === key);
    const [min, max, mean] = [found.min, found.max, found.mean].map((values) => values.map(plotted));
    const [stream, name] = [key.slice(0, key.lastIndexOf(":")), key.slice(key.lastIndexOf(":") + 1)];
    return {
      group: "signal", key: `signal ${key}`, name, tall: true, value: newest(inView(min, time, window), inView(max, time, window)),
      title: [`${name} of ${stream}`, ...bounds.map(({ property, op, value }) => `${property}: ${op} ${value}`)].join("; "),
      paint: (canvas, window) => paintSignal(canvas, window, { ...time, min, max, mean }, bounds, failing),
    };
  });
}

/** A value as it is drawn: near enough where it is an integer that a double can't represent. */
function plotted(value) {
  return value === null ? null : Number(value);
}

/** The newest numbers in view: all that came in as much time as is drawn as one point, from the least to the greatest. */
function newest(min, max) {
  const at = max.findLastIndex((value) => value !== null);
  if (at < 0) return "";
  const [least, greatest] = [inFigures(min[at]), inFigures(max[at])];
  return least === greatest ? greatest : `${least} to\n${greatest}`;
}

function inFigures(value) {
  const rounded = Number(value.toPrecision(4));
  return Math.abs(rounded) < LARGE ? String(rounded) : rounded.toExponential(); // cut off it would be another number
}

function decisions({ asked, denied, hold }, time, window) {
  if (!asked.some(Boolean)) return [];
  const [all, no] = [asked, denied].map((counts) => inView(counts, time, window).reduce((sum, each) => sum + each, 0));
  const longest = hold && all ? `held ${span(Math.max(...inView(hold.max, time, window)))} at most` : "";
  return [{
    group: "decision", name: "decisions", title: "asked, and denied; below, how long each waited", tall: true,
    value: [`${no} of ${all} denied`, longest].filter(Boolean).join("\n"), mood: no ? "denied" : "",
    paint: (canvas, window) => paintDecisions(canvas, window, { ...time, asked, denied, hold: hold?.max ?? [] }),
  }];
}
